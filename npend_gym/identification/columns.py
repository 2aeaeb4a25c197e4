"""What the columns of other programs mean: by their names, and their units.

`ROLES` says by its name what a column is. A new name is a new pattern there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.tables import RUN, Column, Table
from npend_gym.identification.units import METRES, RADIANS, RATES, SECONDS, TORQUES

# Names of columns in lower case, with blanks for underscores, without a unit behind. A number
# counts links, a letter axes.
ROLES = {
    "time": r"t|times?|zeit|temps|tiempo|tempo|tout|sec|seconds?(?: elapsed)?|elapsed(?: time)?|"
    r"time ?stamp|date ?time|time since start(?: in)?",
    "frame": r"frames?|frame number|step",
    "piece": r"piece|trial",
    "axis": r"(?:theta|θ) ?\{?r\}?",  # from the x axis
    "relative": r"pos(?: ?meas)? ?(\d+)",
    "theta": r"(?:(?:pendulum|pole|link|joint) )?(?:theta|θ|ϑ|angle|angular position|alpha|\u03b1|"
    r"phi|φ|winkel|[áâa]ngulo|q|o)(?: ?meas)? ?(\d*)(?: ?(?:meas|measured|mesur[ée]e?))?",
    "omega": r"(?:omega|ω|angular velocity|gyro(?:scope)?|gyr|rotation rate|w) ?(\d*|[xyz])",
    "x": r"x ?(?:m|mass)? ?(\d*)",
    "y": r"y ?(?:m|mass)? ?(\d*)",
    "z": r"z ?(?:m|mass)? ?(\d*)",
    "tau": r"(?:tau|torque|tau ?meas|effort) ?(\d*)",
    "position": r"(?:cart )?position|cart|cart pos|x cart",
    "velocity": r"velocity",
}
NUMBERED = re.compile(r"(theta|tau)\d{1,9}", re.ASCII)  # of our own names
_UNIT = re.compile(r"^(.*?)\s*[(\[]([^()\[\]]*)[)\]]$")
_LAST = re.compile(r"^(.+?)[ _](deg(?:rees?)?|m?rad|radians?|s|sec|[mun]s|[cm]?m|px)$")
_UNITS = {"time": SECONDS, "theta": RADIANS, "axis": RADIANS, "relative": RADIANS,
          "omega": RATES, "axes": RATES, "position": METRES, "tau": TORQUES}  # fmt: skip


class Meant(NamedTuple):
    """A column, what it is, of which link or axis, and its unit in lower case."""

    role: str
    number: int
    unit: str
    column: Column

    @property
    def size(self) -> float:
        """How much its unit is [s, rad, rad/s, m, N m]; 1 of other columns."""
        sizes = _UNITS.get(self.role)
        if sizes is None or not self.unit:
            return 1.0
        if self.unit not in sizes:
            raise ValueError(
                f"the unit of the column {self.column.name!r} must be one of {', '.join(sizes)}; "
                "columns that are given by name are taken as they are"
            )
        return sizes[self.unit]

    @property
    def values(self) -> FloatArray:
        """Its numbers, in these units."""
        return self.column.values * self.size

    @property
    def moves(self) -> bool:
        """Whether its numbers vary."""
        finite = self.column.values[np.isfinite(self.column.values)]
        return finite.size > 0 and bool(np.ptp(finite) > 0.0)


def is_read(name: str) -> bool:
    """Return whether a name is ours for what is read."""
    return name in ("time", "piece", "position") or bool(NUMBERED.fullmatch(name))


def of_role(ours: str, column: Column) -> Meant:
    """Return a column that is what `ours` says, such as "tau0", as it stands, of one run."""
    role = ours.rstrip("0123456789")
    number = int(ours[len(role) :] or -1)
    return Meant(role, number, "", Column(column.name, column.values))


def meaning(column: Column) -> Meant | None:
    """Return the meaning of a column by its name; None if that says nothing."""
    if column.role:
        return of_role(column.role, column)
    found = RUN.match(column.name)
    name = found["name"].strip() if found else column.name
    with_unit = _UNIT.match(name) or _LAST.match(name.lower())
    base, unit = (with_unit[1], with_unit[2]) if with_unit else (name, "")
    base = re.sub(r"[ _]+", " ", base.lower().rpartition("/")[2]).strip()
    for role, pattern in ROLES.items():
        if match := re.fullmatch(pattern, base):
            group = next((g for g in match.groups() if g), "")
            number = int(group) if group.isdecimal() else "xyz".find(group or " ")
            unit = re.sub(r"[ _]s$|\s*(/\s*s(ec)?|[·*]?s(\^-1|⁻¹|-1))$", "/s", unit.strip().lower())
            return Meant(role if group not in ("x", "y", "z") else "axes", number, unit, column)
    return None


def named(table: Table, columns: Mapping[str, str]) -> list[Meant]:
    """Return the columns that are given by name, or have ours, as they stand: in radians."""
    by_name = {one.name: one for one in table.columns}
    missing = set(columns.values()) - by_name.keys()
    if missing:
        raise ValueError(
            f"the file has no column {_checks.show(min(missing))}: it has "
            f"{_checks.show(', '.join(by_name))}"
        )
    others = by_name.keys() - {*columns, *columns.values()}
    if "theta0" not in others:  # other programs number links otherwise
        others -= {name for name in others if NUMBERED.fullmatch(name)}
    given = {name: name for name in by_name if name in others and is_read(name)}
    return [of_role(ours, by_name[name]) for ours, name in (given | dict(columns)).items()]


def angles_in(table: Table, by_role: dict[str, list[Meant]]) -> tuple[str, list[Meant]]:
    """Return which columns show the angles, and what they are."""
    present = [
        role for role in ("theta", "relative", "axis", "x", "omega", "axes") if role in by_role
    ]
    if not present and "position" in by_role and {"velocity", "tau"} & by_role.keys():
        by_role["relative"] = by_role.pop("position")  # of a joint, as in messages of ROS
        present = ["relative"]
    moving = (role for role in present if any(one.moves for one in by_role[role]))
    role = next(moving, present[0] if present else "")
    if not role or (role == "x" and len(by_role.get("y", ())) != len(by_role["x"])):
        by_number = "" if table.named else ", such as --columns time=1,theta0=2"
        way = (
            "its first line must name time, theta0, theta1, ..., and may name tau0, ... and piece; "
            f"other names are given by columns{by_number}"
        )
        if "ccelera" in table.names:
            way = "accelerations show no angle, the rates of a gyroscope do"
        raise ValueError(
            "the file must have the column theta0, or angles, positions x and y, or rates of a "
            f"gyroscope, got {_checks.show(table.names)}: {way}"
        )
    if role == "x" and len(by_role.get("z", ())) == len(by_role["x"]):
        raise ValueError(
            f"x, y and z may be places or the axes of a sensor, got {_checks.show(table.names)}: "
            "name the two that are meant by columns, as x0=x,y0=z, or call the file Gyroscope.csv"
        )
    if role == "axes" and len(by_role[role]) != 3:
        raise ValueError(
            f"rates of a gyroscope must be about x, y and z, got {_checks.show(table.names)}: name "
            "the one that is meant by columns, such as omega0=..."
        )
    return role, single(by_role[role])


def single(found: Sequence[Meant]) -> list[Meant]:
    """Return columns, one for each link; of those in two units, that in the first of them."""
    out = dict[tuple[int, int], Meant]()
    for one in found:
        key = one.column.track, one.number
        if (other := out.setdefault(key, one)) is one or not one.moves:
            continue
        if other.moves and one.unit == other.unit:
            raise ValueError(
                f"the columns {other.column.name!r} and {one.column.name!r} seem to be the same "
                "quantity of one link: name those that are meant by columns"
            )
        sizes = list(_UNITS.get(one.role, {}))
        units = [sizes.index(each.unit) if each.unit in sizes else 0 for each in (one, other)]
        out[key] = one if not other.moves or units[0] < units[1] else other
    return list(out.values())
