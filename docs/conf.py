"""Sphinx: `sphinx-build -W -n docs build/docs` makes the pages, warnings being errors."""

import csv
import os
from pathlib import Path

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

from npend_gym import __version__
from npend_gym.cli import main, parsers

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
    path = ROOT / "benchmarks" / "results" / f"{suite}.csv"
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
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
    path = ROOT / "benchmarks" / "results" / "learning.csv"
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            *cells, learning, collecting = list(row.values())[:-1]  # the last is the machine
            cells[-1] = f"{100 * float(cells[-1]):.0f} %"
            lines.append(f"| {' | '.join([*cells, learning, collecting])} |")
    return "\n".join(lines)


SUITES = "dynamics", "environments", "episodes", "derivatives", "chaos", "ensembles"
myst_substitutions = {suite: benchmark(suite) for suite in SUITES} | {"learning": of_learning()}

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


def setup(app) -> None:
    """Tell Sphinx what this file adds to it."""
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
