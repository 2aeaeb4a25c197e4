"""How columns in the tables of other programs become times, angles and torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.angles import (
    centre_of_circle,
    from_positions,
    from_rates,
    is_circle,
    is_quaternion,
)
from npend_gym.identification.columns import (
    Meant,
    angles_in,
    meaning,
    named,
    of_role,
    single,
)
from npend_gym.identification.instants import MIN_ROWS
from npend_gym.identification.motion import pieces_in_turn
from npend_gym.identification.tables import Column, Table
from npend_gym.identification.units import DEGREE, SECONDS, SPELT

_SINCE_1970 = 1e11, 1e14, 1e17  # numbers from which on instants are in ms, us, ns since then
_LONG_AGO = 1e8  # s; instants that are larger are from another day
_BACKWARDS = 0.01  # of the rows: so many may be late
_ANEW = 0.1  # of a recording: where times fall back to before, another one begins


class Reading(NamedTuple):
    """Angles from a table, and what was understood."""

    times: FloatArray  # (T,) s
    theta: FloatArray  # (T, n) rad, absolute
    torque: FloatArray | None  # (T, n) N m
    piece: FloatArray  # (T,)
    lengths: FloatArray | None  # (n,) of the links, in the unit of the positions
    said: list[str]  # in sentences
    position: FloatArray | None = None  # (T,) of the pivot [m]


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
    meant = named(table, columns) if columns else [meaning(c) for c in table.columns]
    found = [one for one in meant if one is not None]
    if columns and all(one.role != "time" for one in found):
        found += [of_role(c.role, c) for c in table.columns if c.role == "time"]
    if not table.named and not columns:
        found = _guessed(table.columns, frames=fps is not None)
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
        pieces_in_turn([part.piece for part in parts]),
        parts[0].lengths,
        said,
        np.concatenate(places) if len(places) == len(parts) else None,
    )


def _guessed(columns: Sequence[Column], *, frames: bool) -> list[Meant]:
    """Return the meanings of columns without names, where they show."""
    values = [column.values for column in columns]
    if frames and len(columns) in (2, 4, 6, 8):
        return [Meant("xy"[k % 2], k // 2, "", one) for k, one in enumerate(columns)]
    if not bool(np.all(np.diff(values[0]) >= 0.0)) or len(columns) not in (2, 3):
        return []
    roles = ("time", "theta") if len(columns) == 2 else ("time", "x", "y")
    if len(columns) == 3:
        places = np.column_stack(values[1:])
        places = places[np.isfinite(places).all(axis=1)]
        circles = is_circle(places - centre_of_circle(places))
        if not circles or not np.ptp(places, axis=0).all():
            return []
    return [Meant(role, -1, "", one) for role, one in zip(roles, columns, strict=True)]


def _of_run(
    table: Table,
    found: Sequence[Meant],
    run: int,
    degrees: bool,
    relative: bool,
    fps: float | None,
) -> Reading:
    """Motion in the columns of one run; rows with an empty cell are left out."""
    by_role = dict[str, list[Meant]]()
    for one in sorted(found, key=lambda one: (one.column.track, one.number)):
        by_role.setdefault(one.role, []).append(one)
    said = list[str]()
    times = _times(table, by_role, run, fps, said)
    role, chosen = angles_in(table, by_role)
    torques, y = single(by_role.get("tau", ())), single(by_role["y"]) if role == "x" else []
    if role == "x" and len({one.unit for one in (*chosen, *y)}) > 1:
        names = _names([*chosen, *y])
        raise ValueError(f"positions must have one unit, but differ in it: {names}")
    if relative and role in ("x", "axes"):
        what = "positions" if role == "x" else "the axes of one sensor"
        raise ValueError(f"relative must be left out where {what} show the angles")
    moving = [one for one in by_role.get("position", []) if one.moves]
    needed = [*chosen, *y, *torques, *moving, *by_role.get("piece", ())]
    cells = np.column_stack([times, *(one.column.values for one in needed)])
    filled = np.isfinite(cells)
    full, some = np.all(filled, axis=1), np.any(filled, axis=1)
    if np.any(np.abs(cells[full]) > _checks.LARGEST):
        raise ValueError(f"the file must have numbers of at most {_checks.LARGEST:g} in size")
    if empty := int(some.sum() - full.sum()):
        said.append(f"{empty} of {some.sum()} rows have empty cells and are left out")
    if table.lost:
        said.append(f"{table.lost} lines are no rows of the table and are left out")
    names = _names([*chosen, *y])
    if not full.any():
        raise ValueError(f"the file must have rows with numbers in all of {names}")
    labels = by_role["piece"][0].column.values if "piece" in by_role else None
    full = _once(times, cells, full, said)
    full, labels = _in_order(times, full, labels, said)
    sizes = [DEGREE if degrees and role != "x" else one.size for one in chosen]
    values = np.column_stack([one.column.values for one in chosen])[full] * sizes
    if values.shape[1] == 4 and role != "x" and is_quaternion(values):
        raise ValueError(
            f"the columns {names} are a quaternion, because their squares add up to 1, and no "
            "angles of four links: give the angle about the hinge, which is twice the arctangent "
            "of the part along the hinge over w"
        )
    times, lengths, in_degrees = times[full], None, sizes[0] == DEGREE
    if role == "x":
        places = np.stack([values, np.column_stack([one.values for one in y])[full]], axis=2)
        theta, lengths = from_positions(places, fps is not None and not table.named, said)
    elif role in ("omega", "axes"):
        if relative and role == "omega":
            values = np.cumsum(values, axis=1)
            said.append("rates are relative to the link above")
        theta = from_rates(times, values, labels[full], role == "axes", said)
    else:
        if role == "axis" and not in_degrees and float(np.abs(values).max()) > 1.01 * np.pi:
            values, in_degrees = np.radians(values), True
        unit = "degrees" if in_degrees else "radians"
        theta = values + 0.5 * np.pi if role == "axis" else values
        if relative or role == "relative":
            theta = np.cumsum(theta, axis=1)
        how = {"axis": "from the x axis"}.get(role, "from where a link hangs")
        how = "relative to the link above" if relative or role == "relative" else how
        said.append(f"angles are {names}, in {unit}, {how}, counter-clockwise positive")
    torque = _at_joints(torques, chosen, theta.shape[1])
    if torque is not None:
        torque = torque[full]
        said.append(f"torques are {_names(torques)}, in N m")
    position = None
    if moving:
        position = single(moving)[0].values[full]
        said.append(f"{moving[0].column.name!r} is the position of a cart, in metres")
    elif role != "x" and any(one.moves for one in by_role.get("x", ())):
        name = by_role["x"][0].column.name
        said.append(f"{name!r} is not read: position={name} in columns makes it that of a cart")
    known = np.isfinite(theta).all(axis=1)
    torque, position = (None if one is None else one[known] for one in (torque, position))
    return Reading(times[known], theta[known], torque, labels[full][known], lengths, said, position)


def _at_joints(torques: Sequence[Meant], angles: Sequence[Meant], joints: int) -> FloatArray | None:
    """Return the torques of all rows at their joints [N m], None where there are none.

    They are those of their numbers where all angles have these, else they stand in order.
    """
    if not torques:
        return None
    links = [one.number for one in angles][:joints]  # a gyroscope has three axes
    if len(torques) > len(links):
        raise ValueError(f"the file must have an angle for each torque, got {_names(angles)}")
    alike = all(one.number in links for one in torques)
    if not alike and 1 < len(links) != len(torques) and torques[0].number >= 0:
        raise ValueError(
            f"the torques {_names(torques)} must be numbered as the angles {_names(angles)}: name "
            "them by columns, such as tau0=..."
        )
    out = np.zeros((torques[0].values.size, joints))
    for k, one in enumerate(torques):
        out[:, links.index(one.number) if alike else k] = one.values
    return out


def _names(columns: Sequence[Meant]) -> str:
    return ", ".join(repr(one.column.name) for one in columns)


def _once(
    times: FloatArray, cells: FloatArray, full: NDArray[np.bool_], said: list[str]
) -> NDArray[np.bool_]:
    """Return which rows to take: of those that stand twice, as of a sensor read too often, one.

    Where some rows have one time and differ, times are rounded: these rows stay.
    """
    rows = np.flatnonzero(full)
    at_once = np.diff(times[rows]) == 0.0
    before, again = rows[:-1][at_once], rows[1:][at_once]
    if again.size and np.array_equal(cells[again], cells[before]):
        said.append(f"{again.size} rows are the same as those before them and are left out")
        full = full.copy()
        full[again] = False
    return full


def _in_order(
    times: FloatArray, full: NDArray[np.bool_], labels: FloatArray | None, said: list[str]
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which rows to take, and their pieces: where times begin again, another one does.

    Few rows that come too late, as of a sensor that reports twice, are left out.
    """
    if labels is not None:
        return full, labels
    rows, labels = np.flatnonzero(full), np.zeros_like(times)
    back = np.flatnonzero(np.diff(times[rows]) < 0.0) + 1
    starts, ends = times[rows[np.r_[0, back]]], times[rows[np.r_[back, rows.size] - 1]]
    again = starts[1:] - starts[:-1] < _ANEW * (ends - starts)[:-1]
    if back.size and again.all() and np.diff(np.r_[0, back, rows.size]).min() >= MIN_ROWS:
        labels[rows] = np.searchsorted(back, np.arange(rows.size), side="right")
        said.append(f"times begin again {back.size} times: these are {starts.size} recordings")
        return full, labels
    latest = np.maximum.accumulate(np.r_[-np.inf, times[rows]])[:-1]
    late = times[rows] <= latest
    if 0 < late.sum() <= _BACKWARDS * rows.size:
        said.append(f"{late.sum()} rows are no later than those before them and are left out")
        full = full.copy()
        full[rows[late]] = False
    return full, labels


def _times(
    table: Table,
    by_role: dict[str, list[Meant]],
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
        raise ValueError(
            f"the file must have the column time, got {_checks.show(table.names)}: its first "
            "line must name the columns; other names are given by columns"
            + ("" if table.named else ", such as --columns time=1,theta0=2")
            + ", and frames a second by fps"
        )
    chosen = next((one for one in own if one.moves), own[0])
    if not np.isfinite(chosen.values).any():
        raise ValueError(f"the column {chosen.column.name!r} must have times, but it is empty")
    times, unit, start = chosen.values, chosen.unit, np.nanmin(np.abs(chosen.values))
    if not unit:
        unit = ("s", "ms", "us", "ns")[sum(start >= size for size in _SINCE_1970)]
        times = times * SECONDS[unit]
    if np.nanmin(np.abs(times)) > _LONG_AGO:
        times = times - np.nanmin(times)
    said.append(f"times are {chosen.column.name!r}, in {SPELT.get(unit, 'seconds')}")
    return times
