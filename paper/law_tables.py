"""Tables of the law of the centre of mass: as text, as CSV."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from npend_gym.report import write_results
from paper.com_law import LawCell, LawGrid, law_rows
from paper.hesitation import EARLY

_HOLDS_UP_TO = 1.0  # rad


def law_text(cells: Sequence[LawCell], limits: Sequence[Mapping[str, Any]]) -> str:
    """Return the errors of the law, of small angles and of the profile, with a legend."""
    n_values = list(dict.fromkeys(cell.n for cell in cells))
    angles = list(dict.fromkeys(cell.amplitude for cell in cells))
    at = {(cell.n, cell.amplitude): cell for cell in cells}
    head = "a [rad]".rjust(8) + "".join(f"{f'N = {n}':>10}" for n in n_values)
    parts = [
        "error of the law T(N, a), % of the measured pseudo-period of the centre of mass", head,
        *(_line(a, [100.0 * at[n, a].law_error for n in n_values], "+10.3f") for a in angles),
        "", f"fraction of the bobs that are early (before {EARLY} T1)", head,
        *(_line(a, [at[n, a].early for n in n_values], "10.3f") for a in angles),
        "", "root mean square over the others of T_i/T1 minus the profile of small angles", head,
        *(_line(a, [at[n, a].profile_rms for n in n_values], "10.1e") for a in angles),
        "", _limits(limits),
        *_summary(cells),
    ]  # fmt: skip
    return "\n".join(parts)


def _line(amplitude: float, values: Sequence[float], form: str) -> str:
    return f"{amplitude:8.4f}" + "".join(f"{value:{form}}" for value in values)


def _limits(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of small angles."""
    lines = [
        "small angles: error of T1 by one term and by two, T_com/T1, and b of T_com (1 + b a^2)",
        "       N  one term  two terms   T_com/T1     16 b",
    ]
    for row in rows:
        growth = row["com_growth"]
        last = "        -" if math.isnan(growth) else f"{16.0 * growth:9.4f}"
        lines.append(
            f"{row['n']:8d}{row['t1_error']:10.1e}{row['t1_error_two_terms']:11.1e}"
            f"{row['com_over_t1']:11.6f}{last}"
        )
    return "\n".join(lines)


def _summary(cells: Sequence[LawCell]) -> list[str]:
    """Return what the law's largest error is up to 1 rad, of short chains and of others."""
    lines: list[str] = []
    for low, high in ((1, 4), (5, math.inf)):
        chosen = [c for c in cells if low <= c.n <= high and c.amplitude <= _HOLDS_UP_TO]
        if chosen:
            few = ", ".join(map(str, sorted({c.n for c in chosen})))
            text = f"N = {few}" if low < 5 else "N = 5 and more"
            worst = max(chosen, key=lambda cell: abs(cell.law_error))
            lines.append(
                f"largest error up to 1 rad, {text}: {abs(worst.law_error):.3%} "
                f"at N = {worst.n}, {worst.amplitude:.4g} rad"
            )
    return ["", *lines] if lines else []


def write_law(
    grid: LawGrid,
    cells: Sequence[LawCell],
    limits: Sequence[Mapping[str, Any]],
    out: Path,
    *,
    complete: bool,
) -> list[Path]:
    """Write law.csv, limits.csv and manifest.json into `out`; return what was written."""
    tables = {"law": law_rows(cells), "limits": limits}
    return write_results(out, "law", grid.as_dict(), complete=complete, tables=tables)
