"""The tables kept beside the paper: scripts write them, and its numbers and figures read them."""

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from npend_gym import Chain
from npend_gym.report import prepare_file, write_csv
from npend_gym.tools import OK, Parser, dispatch, nonnegative_number

_SHOWN = 11  # columns: the table of the front has hundreds


def read_rows(file: Path) -> list[dict[str, str]]:
    """Return the rows of a table. ValueError is raised if it has none."""
    with file.open(newline="", encoding="utf-8") as opened:
        rows = list(csv.DictReader(opened))
    if not rows:
        raise ValueError(f"{file} has no rows; `python -m paper.period.{file.stem}` writes them")
    return rows


def write_rows(
    about: str | None,
    file: Path,
    runs: Iterable[tuple[int, float]],
    rows_of: Callable[[int, float], Iterable[Mapping[str, object]]],
    unit: str,
) -> None:
    """Run the script that is `about` a table: write the rows of all `runs` to `file`.

    The file appears whole at the end, or stays as it was. Arguments of the command line may name
    another file, and then other runs: numbers of rods, and what `unit` says.
    """

    def run(text: str) -> tuple[int, float]:
        n, _, value = text.partition(":")
        return Chain.uniform(int(n)).n, nonnegative_number(unit, float(value))

    def write(options: dict[str, Any]) -> int:
        prepare_file(options["out"], (".csv",))
        rows: list[Mapping[str, object]] = []
        for n, value in options["runs"] or runs:
            for row in rows_of(n, value):
                print(*[*row.values()][:_SHOWN], flush=True)
                rows.append(row)
        print("written:", write_csv(options["out"], rows))
        return OK

    parser = Parser(prog=f"python -m paper.period.{file.stem}", description=about)
    parser.add_argument("out", nargs="?", type=Path, default=file, metavar="FILE",
                        help=f"the table ({file.name} beside the script)")  # fmt: skip
    parser.add_argument("runs", nargs="*", type=run, metavar=f"N:{unit}", help="what it is of")
    if code := dispatch(parser, write, vars(parser.parse_args())):
        raise SystemExit(code)
