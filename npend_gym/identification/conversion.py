"""What columns of other programs mean, and how positions, rates and relative angles become angles.

`ROLES` says by their names what columns are. A new name is a new pattern there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.motion import passes, pieces_in_turn
from npend_gym.identification.tables import RUN, Column, Table

# Names of columns in lower case, without what stands in brackets behind; a number counts links
ROLES = {
    "time": r"t|time|times|elapsed time|time ?stamp",
    "frame": r"frame|frames|frame number|step",
    "piece": r"piece|trial",
    "axis": r"(?:theta|θ)_?\{?r\}?",  # from the x axis
    "relative": r"pos(?:_meas)?_?(\d+)",
    "theta": r"(?:theta|θ|angle|angular position|phi|φ|q|o)_?(\d*)",
    "omega": r"(?:omega|ω|angular velocity|w)_?(\d*)|gyroscope [xyz]",
    "x": r"x_?(\d*)",
    "y": r"y_?(\d*)",
    "tau": r"(?:tau|torque|tau_meas)_?(\d*)",
}
_UNIT = re.compile(r"^(.*?)\s*[(\[]([^()\[\]]*)[)\]]$")
_DEGREES = "deg", "degree", "degrees", "°", "º", "grad"
_FIXED = 0.05  # of the scatter of the next marker: one that moves less is the pivot
_ROUND = 0.03  # scatter of the distance from the origin, of its mean: the origin is the pivot


class Reading(NamedTuple):
    """Angles from a table, and what was understood."""

    times: FloatArray  # (T,) s
    theta: FloatArray  # (T, n) rad, absolute
    torque: FloatArray | None  # (T, n) N m
    position: FloatArray | None  # (T,) of the pivot [m]
    piece: FloatArray  # (T,)
    lengths: FloatArray | None  # (n,) of the links, in the unit of the positions
    said: list[str]  # in sentences


class _Meant(NamedTuple):
    """A column, what it is, of which link, and whether its unit is degrees."""

    role: str
    number: int
    degrees: bool
    column: Column


def understood(
    table: Table,
    columns: Mapping[str, str],
    *,
    degrees: bool = False,
    relative: bool = False,
    fps: float | None = None,
) -> Reading:
    """Return the angles in a table; `columns` has names in the file by ours, in place of `ROLES`.

    Raises
    ------
    ValueError
        If columns are missing, or there are neither angles nor positions nor rates.
    """
    meant = _named(table, columns) if columns else [_meaning(c) for c in table.columns]
    if columns and "time" not in columns:
        meant += [_of_role(c.role, c) for c in table.columns if c.role == "time"]
    found = [one for one in meant if one is not None]
    if not table.named and not columns and len(table.columns) in (2, 4, 6, 8) and fps is not None:
        found = [_Meant("xy"[k % 2], k // 2, False, one) for k, one in enumerate(table.columns)]
    runs = sorted({one.column.run for one in found if one.role not in ("time", "frame")})
    parts = [
        _of_run(table, [one for one in found if one.column.run == run or one.role == "time"],
                run, degrees, relative, fps)
        for run in runs or [0]
    ]  # fmt: skip
    widths = {part.theta.shape[1] for part in parts}
    if len(widths) > 1:
        raise ValueError(f"runs must have equally many angles, got {sorted(widths)}")
    torques = [part.torque for part in parts if part.torque is not None]
    places = [part.position for part in parts if part.position is not None]
    said = [f"recognised as {table.source}", *dict.fromkeys(s for p in parts for s in p.said)]
    return Reading(
        np.concatenate([part.times for part in parts]),
        np.concatenate([part.theta for part in parts]),
        np.concatenate(torques) if len(torques) == len(parts) else None,
        np.concatenate(places) if places else None,
        pieces_in_turn([part.piece for part in parts]),
        parts[0].lengths,
        said,
    )


def _of_role(ours: str, column: Column) -> _Meant:
    """Return a column that is what stands there, such as "tau0", as it stands, of one run."""
    role = ours.rstrip("0123456789")
    number = int(ours[len(role) :] or -1)
    return _Meant(role, number, False, Column(column.name, column.values))


def _meaning(column: Column) -> _Meant | None:
    if column.role:
        return _of_role(column.role, column)
    found = RUN.match(column.name)
    name = found["name"] if found else column.name
    with_unit = _UNIT.match(name)
    base, unit = (with_unit[1], with_unit[2]) if with_unit else (name, "")
    for role, pattern in ROLES.items():
        if match := re.fullmatch(pattern, base.strip().lower()):
            number = next((int(group) for group in match.groups() if group), -1)
            return _Meant(role, number, unit.strip().lower() in _DEGREES, column)
    return None


def _named(table: Table, columns: Mapping[str, str]) -> list[_Meant]:
    """Return the columns that are given by name, each as it stands: in radians, of one run."""
    by_name = {one.name: one for one in table.columns}
    missing = set(columns.values()) - by_name.keys()
    if missing:
        raise ValueError(
            f"the file has no column {_checks.show(min(missing))}: it has "
            f"{_checks.show(', '.join(by_name))}"
        )
    return [_of_role(ours, by_name[name]) for ours, name in columns.items()]


def _of_run(
    table: Table,
    found: Sequence[_Meant],
    run: int,
    degrees: bool,
    relative: bool,
    fps: float | None,
) -> Reading:
    """Motion in the columns of one run; rows with an empty cell are left out."""
    by_role = dict[str, list[_Meant]]()
    for one in sorted(found, key=lambda one: (one.column.track, one.number)):
        by_role.setdefault(one.role, []).append(one)
    said = list[str]()
    times = _times(table, by_role, run, fps, said)
    role = next((r for r in ("theta", "relative", "axis", "x", "omega") if r in by_role), None)
    if role is None or (role == "x" and len(by_role.get("y", ())) != len(by_role["x"])):
        names = ", ".join(one.name for one in table.columns)
        raise ValueError(
            "the file must have the column theta0, or angles, positions x and y, or rates of a "
            f"gyroscope, got {_checks.show(names)}: its first line must name time, theta0, theta1, "
            "..., and may name tau0, ... and piece; other names are given by columns"
        )
    chosen, torques = by_role[role], by_role.get("tau", [])
    needed = [*chosen, *torques, *(by_role["y"] if role == "x" else ())]
    needed += [one for name in ("piece", "position") for one in by_role.get(name, ())]
    cells = np.column_stack([times, *(one.column.values for one in needed)])
    full = np.all(np.isfinite(cells), axis=1)
    if np.any(np.abs(cells[full]) > _checks.LARGEST):
        raise ValueError(f"the file must have numbers of at most {_checks.LARGEST:g} in size")
    empty = int(np.sum(~full & np.isfinite(times)))
    if empty:
        said.append(f"{empty} of {np.isfinite(times).sum()} rows have empty cells and are left out")
    names = ", ".join(repr(one.column.name) for one in needed)
    if not full.any():
        raise ValueError(f"the file must have rows with numbers in all of {names}")
    values, lengths = np.column_stack([one.column.values for one in chosen])[full], None
    times = times[full]
    in_degrees = degrees or chosen[0].degrees
    if role == "x":
        y = np.column_stack([one.column.values for one in by_role["y"]])[full]
        theta, lengths = _from_positions(np.stack([values, y], axis=2), table.named, said)
    elif role == "omega":
        theta = _from_rates(times, np.radians(values) if in_degrees else values, said)
    else:
        if role == "axis":
            in_degrees |= float(np.abs(values).max()) > 1.01 * np.pi
        theta = np.radians(values) if in_degrees else values
        unit = "degrees" if in_degrees else "radians"
        theta = theta + 0.5 * np.pi if role == "axis" else theta
        if relative or role == "relative":
            theta = np.cumsum(theta, axis=1)
        how = {"axis": "from the x axis"}.get(role, "from where a link hangs")
        how = "relative to the link above" if relative or role == "relative" else how
        said.append(f"angles are {names}, in {unit}, {how}, counter-clockwise positive")
    torque = None
    if torques:
        torque = np.zeros_like(theta)
        links = [one.number for one in chosen]
        if len(torques) > len(links):
            raise ValueError(f"the file must have an angle for each torque, got {names}")
        for k, one in enumerate(torques):
            link = links.index(one.number) if one.number in links else k
            torque[:, link] = one.column.values[full]
    piece = by_role["piece"][0].column.values[full] if "piece" in by_role else 0.0 * times
    position = by_role["position"][0].column.values[full] if "position" in by_role else None
    return Reading(times, theta, torque, position, piece, lengths, said)


def _times(
    table: Table,
    by_role: dict[str, list[_Meant]],
    run: int,
    fps: float | None,
    said: list[str],
) -> FloatArray:
    """Return the instants of all rows [s], of frames where `fps` says how many a second has."""
    columns = by_role.get("time", [])
    own = [one for one in columns if one.column.run == run] or columns
    if fps is not None:
        frames = by_role.get("frame", own)
        numbers = frames[0].column.values if frames else np.arange(len(table.columns[0].values))
        numbers = np.asarray(numbers, np.float64)
        finite = numbers[np.isfinite(numbers)]
        if np.any(finite != np.rint(finite)):
            raise ValueError(
                f"fps must be left out: the column {frames[0].column.name!r} has times, and no "
                "numbers of frames"
            )
        said.append(f"times are frames at {fps:g} a second")
        return numbers / fps
    if not own:
        names = ", ".join(one.name for one in table.columns)
        raise ValueError(
            f"the file must have the column time, got {_checks.show(names)}: its first line must "
            "name the columns; other names are given by columns, and frames a second by fps"
        )
    unit = _UNIT.match(own[0].column.name)
    milliseconds = unit is not None and unit[2].strip().lower() == "ms"
    said.append(f"times are {own[0].column.name!r}, in {'milli' * milliseconds}seconds")
    return own[0].column.values * (1e-3 if milliseconds else 1.0)


def _from_positions(
    places: FloatArray, named: bool, said: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the angles, and the lengths, of links between markers at `places` (T, markers, 2)."""
    scatter = np.sqrt(places.var(axis=0).sum(axis=1))
    if len(scatter) > 1 and scatter[0] < _FIXED * scatter[1]:
        pivot, places, how = np.median(places[:, 0], axis=0), places[:, 1:], "the first marker"
    else:
        away = np.hypot(*places[:, 0].T)
        if np.std(away) < _ROUND * np.mean(away):
            pivot, how = np.zeros(2), "the origin"
        else:
            pivot, how = _centre_of_circle(places[:, 0]), "the centre of the first marker's circle"
    joints = np.concatenate([np.broadcast_to(pivot, (len(places), 1, 2)), places], axis=1)
    x, y = (np.diff(joints[:, :, k], axis=1) for k in (0, 1))
    down = not named or float(np.mean(y[:, 0] / np.hypot(x[:, 0], y[:, 0]))) > 0.5
    theta, lengths = np.arctan2(x, y if down else -y), np.median(np.hypot(x, y), axis=0)
    shown = ", ".join(f"{length:.4g}" for length in lengths.tolist())
    said.append(
        f"positions are read with y {'down' if down else 'up'} and the pivot at {how}; links are "
        f"{shown} long in their unit"
    )
    return theta, lengths


def _centre_of_circle(places: FloatArray) -> FloatArray:
    """Return the centre of the circle on which places (T, 2) lie, by linear least squares."""
    middle: FloatArray = np.asarray(places.mean(axis=0))
    x, y = ((places - middle)[:, k] for k in (0, 1))
    matrix: FloatArray = np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)])
    squares: FloatArray = x**2 + y**2
    return middle + np.linalg.lstsq(matrix, squares, rcond=None)[0][:2]


def _from_rates(times: FloatArray, rates: FloatArray, said: list[str]) -> FloatArray:
    """Return the angle whose rates about three axes, or one, are given [rad/s], about its mean.

    The axis of the hinge is the direction in which rates vary most: a phone may lie obliquely.
    """
    if rates.shape[1] == 3:
        axis = np.linalg.svd(rates - rates.mean(axis=0), full_matrices=False)[2][0]
        axis *= np.sign(axis[np.argmax(np.abs(axis))])
        rates = (rates @ axis)[:, None]
        shown = ", ".join(f"{part:.2f}" for part in axis.tolist())
        said.append(f"the axis of the hinge is ({shown}) in the sensor")
    theta: FloatArray = np.asarray(cumulative_trapezoid(rates, times, axis=0, initial=0))
    said.append("rates are integrated; a steady rate, and the mean angle, are taken as zero")
    for link in range(theta.shape[1]):
        turned = passes(times, rates[:, link] - rates[:, link].mean())
        if turned.size > 1:  # of whole swings from a turning point on, a line has no slope
            whole = (times >= turned[0]) & (times <= turned[-1])
        else:
            whole = np.ones(times.size, np.bool_)
        slope, middle = np.polyfit(times[whole], theta[whole, link], 1).tolist()
        theta[:, link] -= middle + slope * times
    return theta
