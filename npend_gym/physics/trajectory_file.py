"""The file that keeps a trajectory."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.arguments import check_settings, check_states
from npend_gym.physics.functions import NAMES
from npend_gym.physics.integration import MAX_BYTES
from npend_gym.physics.mechanism import AXIAL, PIVOT
from npend_gym.physics.recipe import Function, Recipe
from npend_gym.physics.signals import Signal
from npend_gym.physics.trajectory import EVENTS, Trajectory


def save(motion: Trajectory, path: str | PathLike[str]) -> None:
    """Write the trajectory to `path` as an npz archive, whole or not at all.

    Functions are not written: what needs them says so after `load`.

    Raises
    ------
    ValueError
        If `path` ends in something other than ".npz"; `to_csv` writes text.
    OSError
        If `path` cannot be written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {path}; to_csv(path) writes text")
    made = motion.recipe
    drives = {} if made is None else {name: _plain(getattr(made, name)) for name in NAMES}
    about = json.dumps(
        {
            "chain": motion.chain.as_dict(),
            "chains": [chain.as_dict() for chain in motion.chains],
            "provenance": motion.provenance,
            "recipe": made and made._replace(**drives)._asdict(),
        }
    )
    names = ("times", "theta", "omega", *PIVOT, *AXIAL)
    arrays = {name: getattr(motion, name) for name in names}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    if motion.counts is not None:
        arrays["counts"] = motion.counts
    arrays["status"] = np.array(motion.status)
    for name in EVENTS:
        for k, found in enumerate(getattr(motion, name)):
            many = isinstance(found, list)  # of many motions
            listed = cast("list[FloatArray]", found if many else [found])
            arrays[f"{name}_{k}"] = np.concatenate(listed)
            if many:  # how many each has
                arrays[f"{name}_{k}_sizes"] = np.array([len(each) for each in listed])
    with _files.replacing(path, binary=True) as file:
        np.savez_compressed(file, about=np.array(about), **arrays)


def _plain(drive: Any) -> Any:
    """Return what drives a motion as JSON holds it."""
    if isinstance(drive, np.ndarray):
        return drive.tolist()
    if isinstance(drive, Signal):
        times, values = np.asarray(drive.times).tolist(), np.asarray(drive.values).tolist()
        return {"signal": {"times": times, "values": values, "kind": drive.kind}}
    return {"function": drive.name} if isinstance(drive, Function) else drive


def to_csv(motion: Trajectory, path: str | PathLike[str]) -> None:
    """Write times, angles and angular velocities to `path` as text, whole or not at all.

    The columns are ``time`` [s], ``theta0``, ... [rad] and ``omega0``, ... [rad/s], where the
    motion had a constant torque ``tau0``, ... [N m], and of a cart ``position`` [m] and
    ``velocity`` [m/s], of springs ``stretch0``, ... [m]: the form that `npend identify` and
    `identification.read_motion` read. Numbers are read back to the same bits.

    Raises
    ------
    ValueError
        If these are many motions side by side.
    OSError
        If `path` cannot be written.
    """
    if motion.theta.ndim > 2:
        raise ValueError(f"to_csv writes one motion, got {len(motion)}: trajectory[k].to_csv(path)")
    columns = {"theta": motion.theta, "omega": motion.omega}
    torque = None if motion.recipe is None else motion.recipe.torque
    if isinstance(torque, np.ndarray):
        constant = cast("FloatArray", torque)
        if np.any(constant):
            columns["tau"] = np.broadcast_to(constant, motion.theta.shape)
    for name in AXIAL:
        if getattr(motion, name) is not None:
            columns[name] = getattr(motion, name)
    names = ["time", *(f"{name}{k}" for name in columns for k in range(motion.chain.n))]
    given = {name: getattr(motion, name) for name in PIVOT}
    of_base = {name: each for name, each in given.items() if each is not None}
    for name, each in of_base.items():
        names += [name] if each.ndim == 1 else [f"{name}_x", f"{name}_y"]
    table = np.column_stack([motion.times, *columns.values(), *of_base.values()]).tolist()
    with _files.replacing(Path(path)) as file:
        for row in (names, *table):
            file.write(",".join(map(str, row)) + "\n")  # floats as repr


def load(path: str | PathLike[str]) -> Trajectory:
    """Read what `save` wrote; nothing in the file is executed.

    Raises
    ------
    ValueError
        If the file is not a whole trajectory.
    OSError
        If `path` cannot be read.
    """
    try:
        return _read(Path(path))
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"path must name a trajectory made by save(); {path}: {error}") from error


def _read(path: Path) -> Trajectory:
    """Return the trajectory in an npz archive, every part of it checked."""
    data = _files.read_arrays(path, 2 * MAX_BYTES)
    about = _files.parse_json(str(data["about"]))
    times, chain = _checks.array("times", data["times"]), Chain.from_dict(about["chain"])
    widths = {"theta": (chain.n,), "omega": (chain.n,)}
    if chain.base is not None or "position" in data:
        widths |= dict.fromkeys(PIVOT, (2,) if chain.base is None else ())
    if chain.stiffness is not None:
        widths |= dict.fromkeys(AXIAL, (chain.n,))
    status = data.get("status", np.array(0))
    beyond: dict[str, Any] = {name: _numbers(data, name, status) for name in widths}
    leading = beyond["theta"].shape[:-1]
    if times.ndim != 1 or leading[-1:] != times.shape:
        raise ValueError(f"theta must have the shape {(times.size, chain.n)}, or (B, ...)")
    for name, width in widths.items():
        if beyond[name].shape != (*leading, *width):
            raise ValueError(f"{name} must have the shape {(*leading, *width)}")
    if not isinstance(about["provenance"], dict):
        raise TypeError("its provenance must be a dict")
    made_by = cast("dict[str, Any]", about["provenance"])
    made = _read_recipe(about["recipe"], chain)
    if "counts" in data:
        counts = data["counts"]
        if counts.dtype.kind != "i" or counts.shape != (3, *leading[:-1]):
            raise ValueError(f"counts must hold three integers for each motion, got {counts.shape}")
        beyond["counts"] = counts
    events: dict[str, Any] = {name: _read_events(data, name) for name in EVENTS}
    if status.dtype.kind != "i" or status.shape not in ((), leading[:-1]):
        raise ValueError(f"status must hold an integer for each motion, got shape {status.shape}")
    return Trajectory(
        chain, times, provenance=made_by, recipe=made,
        status=status if status.ndim else int(status), **beyond, **events,
        chains=tuple(Chain.from_dict(each) for each in about.get("chains", [])),
    )  # fmt: skip


def _numbers(data: dict[str, Any], name: str, status: NDArray[Any]) -> FloatArray:
    """Return an array of finite numbers, or NaN after the ends of motions by their `status`."""
    values = data[name]
    if not np.any(status):
        return _checks.array(name, values)
    gaps = np.isnan(values)
    numbers = _checks.array(name, np.where(gaps, 0.0, values))
    numbers[gaps] = np.nan
    return numbers


def _read_events(data: dict[str, Any], name: str) -> list[Any]:
    """Return the instants of each event, or the states there."""
    found: list[Any] = []
    while f"{name}_{len(found)}" in data:
        key = f"{name}_{len(found)}"
        values, sizes = _checks.array(key, data[key]), data.get(f"{key}_sizes")
        if sizes is None:
            found.append(values)
        elif int(np.sum(sizes)) == len(values):
            found.append(np.split(values, np.cumsum(sizes)[:-1]))
        else:
            raise ValueError(f"{key} must have as many rows as {key}_sizes says")
    return found


def _read_recipe(given: Any, chain: Chain) -> Recipe | None:
    """Return how the steps of a saved trajectory were taken, if that is known."""
    if given is None:
        return None
    method, settings = given["method"], {"rtol": 1.0, "atol": 1.0, "dt": None} | given["settings"]
    torque, force, pivot = (_read_drive(given[name]) for name in NAMES)
    if not isinstance(torque, (Signal, Function)):
        torque = check_states(chain.n, torque=torque)[0]
    if not isinstance(force, (Signal, Function)):
        force = _checks.array("force", force)
        force = force if force.ndim else float(force)
    if pivot is not None and not isinstance(pivot, (Signal, Function)):
        pivot = _checks.array("pivot_acceleration", pivot)
        if pivot.shape[-1:] != (2,) or pivot.ndim > 2 or chain.base is not None:
            raise ValueError(f"pivot_acceleration must be two numbers, got shape {pivot.shape}")
    return Recipe(method, check_settings(method, **settings), torque, force, pivot)


def _read_drive(given: Any) -> Any:
    """Return a drive as `_plain` wrote it; a function has only its name left."""
    if not isinstance(given, dict):
        return given
    kept = cast("dict[str, Any]", given)
    if "signal" in kept:
        return Signal(**kept["signal"])
    return Function(None, str(kept["function"]))
