"""Sphinx: `sphinx-build -W -n docs build/docs` makes the pages, warnings being errors."""

import csv
import os
from pathlib import Path

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

from npend_gym import __version__
from npend_gym.cli import main, parsers
from npend_gym.export.readers import MENDS

ROOT = Path(__file__).parent.parent

project = "npend_gym"
author = "the npend_gym developers"
project_copyright = f"2026, {author}"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",  # its role "autolink" links what can be linked in docstrings
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
html_theme = "furo"
html_title = f"npend_gym {version}"
exclude_patterns = ["results"]

# The theme's own, and at the end the releases that `.ci/site` builds side by side
html_sidebars = {"**": [*(f"sidebar/{name}.html" for name in (
    "brand", "search", "scroll-start", "navigation", "scroll-end")), "versions.html"]}  # fmt: skip
html_context = {"versions": os.environ.get("NPEND_VERSIONS", "").split()}
templates_path = ["templates"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"  # what browsers show by themselves: no script, nothing to fetch

myst_enable_extensions = ["colon_fence", "dollarmath", "substitution"]
myst_heading_anchors = 3


def benchmark(suite: str) -> str:
    """Return what `python benchmarks/peers.py` has written about a suite as a table in Markdown."""
    lines = ["| | here [1/s] | peer | peer [1/s] | times as fast |", "|---|---:|---|---:|---:|"]
    for row in results(suite):
        ours, peer = float(row["ours_per_s"]), float(row["peer_per_s"] or "nan")
        beside = f"{short(peer)} | {short(ours / peer)}" if row["peer"] else " | "
        lines.append(f"| {row['job']} | {short(ours)} | {row['peer']} | {beside} |")
    return "\n".join(lines)


def short(number: float) -> str:
    """Return a number in three digits, with M for millions and k for thousands."""
    if number >= 1e4:
        return f"{number / 1e6:.3g} M" if number >= 1e6 else f"{number / 1e3:.3g} k"
    return f"{number:.2g}" if number < 10 else f"{number:.0f}"


def of_learning() -> str:
    """Return what `python benchmarks/learning.py` has written as a table in Markdown."""
    titles = ("learner", "environment", "frames/s, in total", "frames/s, collecting",
              "fraction of time in `step`", "adapter's speed-up, in total",
              "adapter's speed-up, collecting")  # fmt: skip
    lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for row in results("learning"):
        *cells, learning, collecting = list(row.values())[:-1]  # the last is the machine
        cells[-1] = f"{100 * float(cells[-1]):.0f} %"
        lines.append(f"| {' | '.join([*cells, learning, collecting])} |")
    return "\n".join(lines)


def engines() -> str:
    """Return what `python benchmarks/evaluate_engines.py` has written about one case of engines."""
    lines = ["| engine | method | 1 s | 5 s | 10 s | energy | us a step | cases |",
             "|---|---|---:|---:|---:|---:|---:|---:|"]  # fmt: skip
    rows = results("engines")
    for row in rows:
        if row["case"] == SHOWN:
            name = f"{row['engine']}, {row['version']}" if row["version"] else row["engine"]
            played = [one for one in rows if one["engine"] == row["engine"]]
            count = f"{sum(not one['reason'] for one in played)} of {len(played)}"
            numbers = [row[f"error_{t}_s"] for t in (1, 5, 10)] + [row["energy_error"]]
            numbers = [f"{float(one):.0e}" if one else "" for one in numbers]
            cells = [name, row["method"], *numbers, row["us_per_step"], count]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def engines_by_case() -> str:
    """Return the errors of some engines after 1 s in all cases."""
    some = ("npend_gym dop853", "npend_gym rk4", "MuJoCo RK4", "MuJoCo Euler", "Drake RK3",
            "Pinocchio RK4", "PyBullet")  # fmt: skip
    lines = [f"| case | {' | '.join(some)} |", "|---|" + "---:|" * len(some)]
    rows = {(row["case"], row["engine"]): row["error_1_s"] for row in results("engines")}
    for case in dict.fromkeys(case for case, _ in rows):
        errors = [rows.get((case, name), "") for name in some]
        cells = [f"{float(error):.0e}" if error else "-" for error in errors]
        lines.append(f"| {case} | {' | '.join(cells)} |")
    return "\n".join(lines)


def engines_that_cannot() -> str:
    """Return which engines could not play which cases, and why."""
    cases: dict[tuple[str, str], list[str]] = {}
    for row in results("engines"):
        if row["reason"]:
            reason = row["reason"].partition("; got")[0]
            cases.setdefault((row["engine"], reason), []).append(row["case"])
    every = len({row["case"] for row in results("engines")})
    lines = ["| engine | cases | reason |", "|---|---|---|"]
    for (engine, reason), names in cases.items():
        which = "all" if len(names) == every else ", ".join(names)
        lines.append(f"| {engine} | {which} | `{reason}` |")
    return "\n".join(lines)


def derivatives_of_engines() -> str:
    """Return the errors of the engines' derivatives."""
    rows = {(row["case"], row["engine"]): row["error"] for row in results("derivatives_of_engines")}
    names = [*dict.fromkeys(engine for _, engine in rows)]
    lines = [f"| case | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    for case in dict.fromkeys(case for case, _ in rows):
        errors = [rows.get((case, name), "") for name in names]
        cells = [f"{float(error):.0e}" if error else "-" for error in errors]
        lines.append(f"| {case} | {' | '.join(cells)} |")
    return "\n".join(lines)


def engines_read() -> str:
    """Return what `python benchmarks/engines_read.py` has written: what engines make of files."""
    rows = results("engines_read")
    names = [*dict.fromkeys(row["property"] for row in rows)]
    lines = [f"| engine | file | {' | '.join(names)} |", "|---|---|" + "---|" * len(names)]
    signs = {"kept": "kept", "not in the format": ""}
    for key in dict.fromkeys((row["engine"], row["version"], row["format"]) for row in rows):
        engine, release, kind = key
        cells = []
        for row in rows:
            if (row["engine"], row["format"]) == (engine, kind):
                first = row["as_it_is"]
                mended = row["mended"] == "kept" and first != "kept"
                shown = signs.get(first, first if first in ("lost", "changed") else "refused")
                cells.append(f"{shown}, mended" if mended else shown)
        lines.append(f"| {engine} {release} | {kind.upper()} | {' | '.join(cells)} |")
    return "\n".join(lines)


def mends() -> str:
    """Return the lines that mend what engines lose, as `npend export --for` prints them."""
    lines = ["| engine | file | property | line |", "|---|---|---|---|"]
    for (engine, kind, name), line in MENDS.items():
        shown = f"`{line}`" if not line.startswith("no line") else line
        lines.append(f"| {engine} | {kind.upper() or 'all'} | {name} | {shown} |")
    return "\n".join(lines)


def results(name: str) -> list[dict[str, str]]:
    """Return the rows of a file of results."""
    path = ROOT / "benchmarks" / "results" / f"{name}.csv"
    with path.open(encoding="utf-8") as file:
        return [*csv.DictReader(file)]


SHOWN = "links"  # the case whose table has all engines
SUITES = "start", "dynamics", "environments", "episodes", "derivatives", "chaos", "ensembles"
myst_substitutions = {suite: benchmark(suite) for suite in SUITES} | {"learning": of_learning()}
myst_substitutions |= {
    table.__name__: table()
    for table in (
        engines,
        engines_by_case,
        engines_that_cannot,
        derivatives_of_engines,
        engines_read,
        mends,
    )
}

man_pages = [
    ("commands", "npend", "release, measure, train and look at chains of pendulums", author, 1)
]


def commands() -> str:
    """Return the help of every command as Markdown, from the parser itself."""
    os.environ["COLUMNS"] = "88"
    parser, each = parsers()
    text = f"```text\n{parser.format_help()}```\n"
    for name, command in each.items():
        command.load()
        text += f"\n## npend {name}\n\n```text\n{command.format_help()}```\n"
    return text


def fill_in_commands(_app, docname: str, source: list[str]) -> None:
    """Put the help in place of its mark, headings and all, which a substitution could not."""
    if docname == "commands":
        source[0] = source[0].replace("{{ commands }}", commands())


def formula(translator, node) -> None:
    """Write a formula within a line as MathML."""
    translator.body.append(convert(node.astext()))
    raise SkipNode


def displayed_formula(translator, node) -> None:
    """Write a formula of its own as MathML, in a box that scrolls where the screen is narrow."""
    mathml = convert(node.astext(), display="block")
    translator.body.append(f'<div class="math" tabindex="0">{mathml}</div>')
    raise SkipNode


ACCESSIBLE = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    "<pre>": '<pre tabindex="0">',  # what scrolls can be reached by the keyboard
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
}


def make_accessible(_app, _page, _template, context, _doctree) -> None:
    """Give the elements of Sphinx and the theme what keyboards and screen readers need."""
    for part in ("body", "furo_navigation_tree"):
        for given, wanted in ACCESSIBLE.items():
            context[part] = context.get(part, "").replace(given, wanted)


def write_live_page(app, exception: Exception | None) -> None:
    """Put the page to play with beside live_page.html, which shows it in a frame."""
    if exception is None and app.builder.format == "html":
        main(["play", "--out", str(Path(app.outdir) / "live.html")])


def drop_docstring_of_type(app, kind, name, value, options, lines) -> None:  # noqa: ARG001
    """Leave constants without the docstring of their type, such as that of all tuples."""
    if kind == "data":
        lines.clear()


def setup(app) -> None:
    """Tell Sphinx what this file adds to it."""
    app.connect("autodoc-process-docstring", drop_docstring_of_type, priority=0)
    app.connect("html-page-context", make_accessible, priority=900)  # after the theme's own
    app.connect("build-finished", write_live_page)
    app.connect("source-read", fill_in_commands)
    app.add_html_math_renderer("mathml", (formula, None), (displayed_formula, None))


default_role = "autolink"
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say more
# For the pages alone too heavy
autodoc_mock_imports = ["stable_baselines3", "tensordict", "torch", "torchrl"]
napoleon_google_docstring = False
napoleon_use_param = napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # docstrings give types; the letters of generic ones mean nothing
napoleon_custom_sections = [
    "Description",
    "Action",
    "Observation",
    "Reward",
    "Success",
    "Starting state",
    "Episode end",
    "Info",
    "Tasks",
    "Version history",
]

# Names of our own must be found; types in docstrings are words, and nothing is fetched
nitpick_ignore_regex = [("py:.*", r"(?!npend_gym\.).*")]
# The letters of shapes, as in (A, C), are names of fields elsewhere
suppress_warnings = ["ref.python"]
