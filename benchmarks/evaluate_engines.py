"""How exact and how fast simulation engines are on the reference cases of `certify`.

    python benchmarks/evaluate_engines.py --out benchmarks/results  all that are installed
    python benchmarks/evaluate_engines.py --engine "MuJoCo RK4" --case links
    python benchmarks/evaluate_engines.py --derivatives -o results  of the state after 1 s
    python benchmarks/evaluate_engines.py --make-references         compute the cases; needs heyoka

Engines with fixed steps take steps of 1/1024 s. `certify/README.md` describes the cases, and how
an engine is added. An engine that is missing, cannot express a case or diverges gets a row with
the reason.
The file keeps the rows of engines and cases that are not run again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from certify import derivatives, jax_runners, oracle, runners
from certify.cases import TIMES, Case, read
from csv_tables import merged_rows

from npend_gym import __version__
from npend_gym.report import prepare_folder, write_csv, write_figure
from npend_gym.tools import OK, Parser, can_draw, dispatch, machine, show_written

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # an extra

STEP = 2.0**-10  # s
DIVERGED = 100.0  # from what error of the energy on, in units of that which lifts the chain
SHOWN = "links"  # the case of the figure and the main table: its bodies have inertia
ENGINES = runners.ENGINES | jax_runners.ENGINES
Row = dict[str, Any]


def rows(cases: Sequence[Case], names: Sequence[str]) -> Iterator[Row]:
    """Yield what each engine made of each case, or why it could not."""
    return _rows(product(cases, names), _played)


def _rows(pairs: Iterable[tuple[Case, str]], play: Callable[[str, Case], Row]) -> Iterator[Row]:
    made_by = {"made_by": machine()}
    for case, name in pairs:
        yield _about(name, case) | _tried(partial(play, name, case)) | made_by


def _played(name: str, case: Case) -> Row:
    played = runners.play(ENGINES[name], case, STEP)
    errors = runners.errors(case, played)
    columns = {f"error_{t}_s": f"{e:.3g}" for t, e in zip(TIMES, errors, strict=True)}
    error = runners.energy_error(case, played)
    if not error < DIVERGED:
        return {"reason": "diverged"}
    drift = f"{error:.3g}"
    return columns | {
        "energy_error": drift, "us_per_step": f"{played.microseconds:.3g}", "steps": played.steps
    }  # fmt: skip


def derivative_rows(cases: Sequence[Case], names: Sequence[str]) -> Iterator[Row]:
    """Yield the relative error of each engine's derivative of the state after 1 s by the start."""
    given = [case for case in cases if case.derivative is not None]
    engines = [name for name in derivatives.ENGINES if name in names]
    return _rows(product(given, engines), partial(derivatives.compared, dt=STEP))


def _about(name: str, case: Case) -> Row:
    engine = ENGINES[name]
    try:
        release = version(engine.package.replace("_", "-"))
    except PackageNotFoundError:
        release = "" if engine.package != "npend_gym" else __version__
    about = {"case": case.name, "engine": name, "version": release, "method": engine.method}
    return about | {"precision": engine.precision, "reason": ""}


def _tried(play: Callable[[], Row]) -> Row:
    """Return the row that `play` makes, or the reason why it does not."""
    try:
        return play()
    except Exception as error:  # noqa: BLE001
        lines = str(error).splitlines() or [""]
        return {"reason": f"{type(error).__name__}: {lines[0][:120]}"}


def line(row: Row) -> str:
    """Return a row to be read on a terminal."""
    numbers = [f"{key} {row[key]}" for key in row if key.startswith(("error", "energy", "us_"))]
    return f"{row['case']:10s} {row['engine']:20s} {row['reason'] or '  '.join(numbers)}"


def diagram(done: Sequence[Row], case: str = SHOWN) -> Figure:
    """Draw the error after 1 s of each engine against the time of a step, for one case."""
    from matplotlib.figure import Figure

    from npend_gym.report import styled

    @styled
    def draw() -> Figure:
        figure = Figure(figsize=(7.2, 4.8))
        axes = figure.add_subplot()
        shown = [row for row in done if row["case"] == case and not row["reason"]]
        for k, row in enumerate(shown):  # ten markers and seven colours make 70 pairs
            axes.plot(
                float(row["us_per_step"]), max(float(row["error_1_s"]), 1e-16),
                "os^vDP*X<>"[k % 10], color=f"C{k % 7}", markersize=8, label=row["engine"],
            )  # fmt: skip
        axes.set(
            xscale="log", yscale="log", xlabel="CPU time of a step [us]",
            ylabel="error after 1 s [rad]",
            title=f'Case "{case}": fixed steps of 1/1024 s, or adaptive steps',
        )  # fmt: skip
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return figure

    return draw()


FIELDS = ("case", "engine", "version", "method", "precision", *(f"error_{t}_s" for t in TIMES),
          "energy_error", "us_per_step", "steps", "reason", "made_by")  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print, row by row; return the exit code."""
    parser = Parser(prog="benchmarks/evaluate_engines.py", description=__doc__)
    cases = {case.name: case for case in read()}
    parser.add_argument("--engine", action="append", choices=ENGINES, help="one, or several (all)")
    parser.add_argument("--case", action="append", choices=cases, help="one, or several (all)")
    parser.add_argument("--derivatives", action="store_true", help="compare derivatives")
    parser.add_argument("--make-references", action="store_true", help="compute the cases")
    parser.add_argument("--json", action="store_true", help="print the rows as JSON at the end")
    parser.add_argument("-o", "--out", type=Path, metavar="FOLDER", help="write a CSV file there")
    options = parser.parse_args(argv)
    if options.derivatives:
        without = [name for name in options.engine or () if name not in derivatives.ENGINES]
        without += [name for name in options.case or () if cases[name].derivative is None]
        if without:
            parser.error(f"--derivatives: there are no derivatives of {', '.join(without)}")
    return dispatch(parser, _run, vars(options) | {"cases": cases})


def _run(options: dict[str, Any]) -> int:
    if options["make_references"]:
        oracle.make(print)
        return OK
    out, as_json = options["out"], options["json"]
    if out is not None:
        prepare_folder(out)
    cases = [options["cases"][name] for name in options["case"] or options["cases"]]
    kind, fields = ("derivatives_of_engines", derivatives.FIELDS) if options["derivatives"] else (
        "engines", FIELDS)  # fmt: skip
    yielding = derivative_rows if options["derivatives"] else rows
    done: list[Row] = []
    try:
        for row in yielding(cases, options["engine"] or [*ENGINES]):
            done.append({field: row.get(field, "") for field in fields})
            print(line(row), file=sys.stderr if as_json else sys.stdout, flush=True)
    finally:
        if out is not None and done:
            path = out / f"{kind}.csv"
            merged = _merged(path, done)
            written = [write_csv(path, merged)]
            drawn = kind == "engines" and any(row["case"] == SHOWN for row in merged)
            if drawn and can_draw():
                written.append(write_figure(out / "engines.png", diagram(merged)))
            if not as_json:
                show_written(written)
    if as_json:
        print(json.dumps(done))
    return OK


def _merged(path: Path, done: Sequence[Row]) -> list[Row]:
    """Return the rows of a file, those of the same case and engine replaced, and the new ones."""
    rows = merged_rows(path, done, "case", "engine")
    cases, engines = [case.name for case in read()], [*ENGINES]
    cases += [row["case"] for row in rows]  # names that are no longer known come last
    engines += [row["engine"] for row in rows]
    return sorted(rows, key=lambda row: (cases.index(row["case"]), engines.index(row["engine"])))


if __name__ == "__main__":
    if code := main():
        raise SystemExit(code)
