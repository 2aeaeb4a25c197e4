"""The twelve cases, and how they are read from the file.

Every parameter and every start is a float of few bits, so an engine in binary arithmetic begins
with exactly the numbers of the file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from certify.equations import Mechanism

FILE = Path(__file__).with_name("references.json")
FORMAT = "reference cases of chains, 1"
TIMES = (1, 5, 10)  # s
PARTS = ("theta", "position", "stretch")
RATES = ("omega", "velocity", "stretch_rate")


def _case(
    name: str,
    about: str,
    theta: str,
    omega: str = "0",
    torque: tuple[tuple[str, str], ...] = (),
    **chain: str,
) -> dict[str, Any]:
    """Return a case as the file has it; one number of a list stands for all links."""
    n = len(theta.split())

    def numbers(text: str) -> list[str]:
        each = text.split()
        return each * n if len(each) == 1 else each

    given = {"masses": "1", "lengths": "1", "inertias": "0", "damping": "0", "drag": "0"}
    given |= {"axial_damping": "0"} | chain
    given.setdefault("centres", given["lengths"])
    single = {"gravity": "9.8125", "cart_damping": "0"} | chain
    about_chain = {
        field: single.get(field)
        if field in ("gravity", "cart_mass", "cart_damping")
        else numbers(given[field]) if field in given else None
        for field in Mechanism._fields
    }  # fmt: skip
    pieces = [{"until": until, "torque": numbers(values)} for until, values in torque]
    start = {"theta": numbers(theta), "omega": numbers(omega)}
    if about_chain["cart_mass"] is not None:
        start |= {"position": ["0"], "velocity": ["0"]}
    if about_chain["stiffness"] is not None:
        start |= {"stretch": ["0"] * n, "stretch_rate": ["0"] * n}
    return {"name": name, "about": about, "chain": about_chain, "torque": pieces, "start": start}


DEFINED = [
    _case("one-rod", "a bob on a rod, released from 115 degrees", "2"),
    _case("two-rods", "two equal rods, far from small oscillations", "2 1.5"),
    _case("five-rods", "five equal rods", "0.75 0.75 0.75 0.75 0.75"),
    _case("uneven", "three unequal bobs and rods", "1 -0.5 0.25", "0 1 -2",
          masses="1 0.25 2", lengths="1 0.5 0.75"),
    _case("links", "three rigid links, which start with a spin", "0.75 0.5 0.25", "1 0 -1",
          masses="1 0.75 0.5", lengths="1 0.75 0.5", centres="0.5 0.25 0.25",
          inertias="0.125 0.0625 0.03125"),
    _case("cart", "two rods on a cart that rolls freely", "1.5 0.5", cart_mass="2"),
    _case("driven", "torques in both joints, constant in four pieces", "0 0",
          torque=(("2.5", "8 -2"), ("4", "-8 4"), ("7.5", "4 -4"), ("10", "0 6"))),
    _case("damped", "three rods with damped joints", "2 1.5 1", damping="0.25 0.125 0.0625"),
    _case("drag", "two bobs in a viscous fluid", "2 2.5", drag="0.25 0.125"),
    _case("stiff", "a light bob between heavy ones: it vibrates at 25 Hz", "0.75 0.5 0.625",
          masses="1 0.015625 2", lengths="1 0.25 0.25"),
    _case("springs", "two bobs on springs in place of rods, at 5 to 12 Hz", "1 0.5",
          stiffness="2048", axial_damping="0"),
    _case("long", "eight rods of 1/4 m", " ".join(["0.5"] * 8), masses="0.25", lengths="0.25"),
]  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A case of the file."""

    record: dict[str, Any]

    @property
    def name(self) -> str:
        """Its name."""
        return self.record["name"]

    @cached_property
    def mechanism(self) -> Mechanism:
        """The chain in float64."""
        return Mechanism.of(self.record["chain"])

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.mechanism.masses)

    @cached_property
    def start(self) -> NDArray[np.float64]:
        """The state at 0 s, (2, m)."""
        return state_of(self.record["start"])

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """The reference states at TIMES, rounded to float64, (3, 2, m)."""
        return np.array([state_of(state) for state in self.record["states"]])

    @cached_property
    def derivative(self) -> NDArray[np.float64] | None:
        """The derivative of the state at 1 s by the state at 0 s, (2m, 2m); None if not given."""
        rows = self.record.get("derivative")
        return None if rows is None else np.array(rows, float)

    @cached_property
    def pieces(self) -> list[tuple[float, NDArray[np.float64]]]:
        """Until when [s] which torques act, one after the other, (n,) each."""
        given = [(float(one["until"]), np.array(one["torque"], float))
                 for one in self.record["torque"]]  # fmt: skip
        return given or [(float(TIMES[-1]), np.zeros(self.n))]

    @cached_property
    def intervals(self) -> list[tuple[float, float, NDArray[np.float64]]]:
        """Begin, end [s] and torque of each interval in which no torque changes, up to TIMES."""
        ends = sorted({*map(float, TIMES), *(until for until, _ in self.pieces)})
        return [
            (begin, end, next(torque for until, torque in self.pieces if until >= end))
            for begin, end in zip([0.0, *ends], ends, strict=False)
        ]


def state_of(record: dict[str, Any], number: Any = float) -> Any:
    """Return coordinates and velocities of a record, (2, m)."""
    rows = [[number(text) for name in names for text in record.get(name, ())]
            for names in (PARTS, RATES)]  # fmt: skip
    return np.array(rows)


def read(file: Path = FILE) -> list[Case]:
    """Return the cases of a file.

    Raises
    ------
    ValueError
        If it has another format.
    """
    record = json.loads(file.read_text(encoding="utf-8"))
    if record.get("format") != FORMAT:
        raise ValueError(f"format must be {FORMAT!r}, got {record.get('format')!r}")
    return [Case(one) for one in record["cases"]]
