"""Units in files of other programs."""

from __future__ import annotations

import math
import re

# How much a unit is [s, rad, rad/s, m, N m]; that of a column without one is the first
SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "sek": 1.0, "ms": 1e-3,
            "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0}  # fmt: skip
DEGREE, _TURN = math.pi / 180.0, 2.0 * math.pi
RADIANS = {"rad": 1.0, "radian": 1.0, "radians": 1.0, "mrad": 1e-3, "rev": _TURN, "turns": _TURN}
RADIANS.update(dict.fromkeys(("deg", "degree", "degrees", "°", "º", "grad"), DEGREE))
RATES = (
    {f"{unit}/s": size for unit, size in RADIANS.items()}
    | RADIANS
    | {"dps": DEGREE, "rpm": _TURN / 60.0}
)
SPELT = {"ms": "milliseconds", "us": "microseconds", "µs": "microseconds", "μs": "microseconds",
          "ns": "nanoseconds", "min": "minutes"}  # fmt: skip
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
TORQUES = {"n m": 1.0, "nm": 1.0, "n*m": 1.0, "n·m": 1.0, "n.m": 1.0, "n-m": 1.0, "mnm": 1e-3,
            "mn m": 1e-3}  # fmt: skip
_OTHERS = re.compile(r"|[(\[].*[)\]]|[NVAg%-]|mA|Hz|°C|px|counts?|[cm]?m/s|(rad|deg|°|m)/s(\^?2|²)")


def is_unit(cell: str) -> bool:
    """Return whether a cell may stand in a line of units below names; an empty one may."""
    known = (SECONDS, RADIANS, RATES, METRES, TORQUES)
    return any(cell.lower() in sizes for sizes in known) or bool(_OTHERS.fullmatch(cell))
