"""What simulation engines make of the files that we write: accelerations at random states.

    python benchmarks/engines_read.py --out benchmarks/results        all that are installed
    python benchmarks/engines_read.py --engine Drake

For each property of a chain there is a chain with it. An engine keeps the property where its
accelerations are those of the chain; it loses it where they are those of the chain without. Each
engine reads each file twice: as it is, and with the lines that mend the rest, which are in
`readers/engines.py`. The file keeps the rows of engines that are not run again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from csv_tables import merged_rows
from readers.engines import READERS, Accelerations

from npend_gym import Cart, Chain
from npend_gym.physics import accelerations
from npend_gym.report import prepare_folder, write_csv
from npend_gym.tools import OK, FloatArray, Parser, dispatch, show_written

STATES = 20
FIELDS = ("engine", "version", "format", "property", "as_it_is", "error", "mended", "error_mended")
LINKS: dict[str, Any] = {
    "masses": [1.0, 0.7, 0.4], "lengths": [0.8, 0.5, 0.6], "centres": [0.5, 0.2, 0.3],
    "inertias": [0.02, 0.03, 0.01],
}  # fmt: skip
BOBS: dict[str, Any] = {"masses": [0.01, 0.01], "lengths": 0.05}
# What each property adds to a chain; None: it is there from the start
CASES: dict[str, tuple[dict[str, Any], dict[str, Any] | None]] = {
    "links": (LINKS, None),
    "bobs of 10 g": (BOBS, None),
    "gravity": (LINKS, {"gravity": 3.7}),
    "cart": (LINKS | {"base": Cart(1.5)}, None),
    "damping": (LINKS, {"damping": [0.1, 0.2, 0.3]}),
    "friction": (LINKS, {"friction": 0.3, "friction_speed": 1e-3}),
    "armature": (LINKS, {"armature": [0.0, 0.1, 0.1]}),
    "springs": (LINKS | {"stiffness": 1e-9}, {"stiffness": 300.0}),
}


def states_of(chain: Chain) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield positions and velocities of the joints in the file, and the matrix of the angles."""
    rng, n = np.random.default_rng(0), chain.n
    carts, springs = int(chain.base is not None), chain.stiffness is not None
    for _ in range(STATES):
        angles = rng.uniform(-3.0, 3.0, n)
        rates = rng.uniform(0.4, 2.0, n) * rng.choice([-1.0, 1.0], n)  # nothing is near rest
        places, speeds = ([angles], [rates])
        if springs:
            places, speeds = [angles, rng.uniform(-0.1, 0.1, n)], [rates, rng.normal(size=n)]
        each = (np.stack(parts, -1).ravel() for parts in (places, speeds))
        q, v = (np.r_[[0.3] * carts, part] for part in each)
        yield q, v, np.cumsum([angles, rates], axis=1)


def expected_of(chain: Chain, q: FloatArray, v: FloatArray, turned: FloatArray) -> FloatArray:
    """Return the accelerations of the joints in the file."""
    n, carts, more = chain.n, int(chain.base is not None), dict[str, Any]()
    if chain.stiffness is not None:
        more = {"stretch": q[carts + 1 :: 2], "stretch_rate": v[carts + 1 :: 2]}
    if carts:
        more["velocity"] = v[0]
    found = accelerations(chain, *turned, **more)
    each = np.diff(found[:n], prepend=0.0)
    if chain.stiffness is not None:
        each = np.stack([each, found[-n:]], -1).ravel()
    return np.r_[found[n : n + carts], each]


def judged(read: Accelerations, chain: Chain, without: Chain | None, within: float) -> Any:
    """Return what an engine makes of a chain, and the relative error of its accelerations."""
    errors = np.zeros(2)
    for q, v, turned in states_of(chain):
        found = np.asarray(read(q, v), float)
        for k, other in enumerate((chain, without)):
            if other is not None:
                expected = expected_of(other, q, v, turned)
                error = np.max(abs(found - expected)) / np.max(abs(expected))
                errors[k] = np.fmax(errors[k], error if np.isfinite(error) else np.inf)
    if errors[0] <= within:
        return "kept", errors[0]
    lost = without is not None and errors[1] <= within
    return "lost" if lost else "changed", errors[0]


def rows(names: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield what each engine makes of each property in each format."""
    for name in names:
        reader = READERS[name]
        try:
            release = version(reader.package)
        except PackageNotFoundError:
            continue
        for kind in reader.formats:
            for case, (given, more) in CASES.items():
                chain = Chain(**(given | (more or {})))
                without = None if more is None else Chain(**given)
                row = {"engine": name, "version": release, "format": kind, "property": case}
                try:
                    text = getattr(chain, f"to_{kind}")()
                except ValueError:
                    yield row | {"as_it_is": "not in the format"}
                    continue
                for mend, column, error in ((None, "as_it_is", "error"),
                                            (chain, "mended", "error_mended")):  # fmt: skip
                    try:
                        read = reader.read(text, kind, mend)
                        # Constraints of friction are soft
                        within = max(reader.within, 1e-4 * (case == "friction"))
                        within = max(within, 1e-6 * (kind == "usd"))  # numbers in float32
                        row[column], found = judged(read, chain, without, within)
                        row[error] = f"{found:.1e}"
                    except Exception as reason:  # noqa: BLE001, PERF203
                        lines = str(reason).splitlines() or [""]
                        row[column] = f"{type(reason).__name__}: {lines[0][:100]}"
                yield row


def main(argv: Sequence[str] | None = None) -> int:
    """Compare and print, row by row; return the exit code."""
    parser = Parser(prog="benchmarks/engines_read.py", description=__doc__)
    parser.add_argument("--engine", action="append", choices=READERS, help="one, or several (all)")
    parser.add_argument("-o", "--out", type=Path, metavar="FOLDER", help="write a CSV file there")
    return dispatch(parser, _run, vars(parser.parse_args(argv)))


def _run(options: dict[str, Any]) -> int:
    done = []
    for row in rows(options["engine"] or [*READERS]):
        done.append({field: row.get(field, "") for field in FIELDS})
        print("  ".join(str(value) for value in done[-1].values()), flush=True)
    if options["out"] is not None and done:
        prepare_folder(options["out"])
        path = options["out"] / "engines_read.csv"
        merged = merged_rows(path, done, "engine", "format", "property")
        order = [*READERS]
        show_written([write_csv(path, sorted(merged, key=lambda row: order.index(row["engine"])))])
    return OK


if __name__ == "__main__":
    if code := main():
        raise SystemExit(code)
