"""The file that keeps a trajectory."""

from __future__ import annotations

import json
import math
from itertools import count, takewhile
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.functions import NAMES
from npend_gym.physics.integration import MAX_BYTES, check_settings, check_times
from npend_gym.physics.mechanism import AXIAL, PIVOT, mechanism_of
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
            "recipe": made and made._replace(**drives, longest_step=None)._asdict(),
        }
    )
    names = ("times", "theta", "omega", *PIVOT, *AXIAL, "counts", "ends")
    arrays = {name: getattr(motion, name) for name in names}
    arrays = {name: array for name, array in arrays.items() if array is not None}
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
    """Drives of a motion as JSON holds them."""
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
    ``velocity`` [m/s], of springs ``stretch0``, ... [m]. Of a chain that hangs from a fixed pivot
    this is the form that `npend identify` and `identification.read_motion` read. Numbers are read
    back to the same bits.

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
    times, chain = check_times(data["times"], 1), Chain.from_dict(about["chain"])
    widths = {"theta": (chain.n,), "omega": (chain.n,)}
    if chain.base is not None or "position" in data:
        widths |= dict.fromkeys(PIVOT, (2,) if chain.base is None else ())
    if chain.stiffness is not None:
        widths |= dict.fromkeys(AXIAL, (chain.n,))
    status = data.get("status", np.array(0))
    beyond: dict[str, Any] = {name: _numbers(data, name, status) for name in widths}
    leading = beyond["theta"].shape[:-1]
    many = leading[:-1]
    if leading[-1:] != times.shape:
        raise ValueError(f"theta must have the shape {(times.size, chain.n)}, or (B, ...)")
    for name, width in widths.items():
        if beyond[name].shape != (*leading, *width):
            raise ValueError(f"{name} must have the shape {(*leading, *width)}")
    if not isinstance(about["provenance"], dict):
        raise TypeError("its provenance must be a dict")
    made_by = cast("dict[str, Any]", about["provenance"])
    made = _read_recipe(about["recipe"], chain, many)
    if "counts" in data:
        counts = data["counts"]
        if counts.dtype.kind != "i" or counts.shape != (3, *many) or np.any(counts < 0):
            raise ValueError(
                f"counts must be 3 integers for each motion, got {_checks.show(counts)}"
            )
        beyond["counts"] = counts
    if status.dtype.kind != "i" or status.shape not in ((), many) or np.any((status | 1) != 1):
        raise ValueError(f"status must hold 0 or 1 for each motion, got {_checks.show(status)}")
    if "ends" in data:
        beyond["ends"] = ends = _numbers(data, "ends", status)
        shape = (*many, 1 + sum(map(math.prod, widths.values())))
        if ends.shape != shape or np.any(np.isfinite(ends) != (status[..., None] == 1)):
            raise ValueError(f"ends must be {shape[-1]} numbers for each motion that ended")
    chains = tuple(Chain.from_dict(each) for each in about.get("chains", []))
    if chains and ((len(chains),) != many or chains[0] != chain):
        raise ValueError(f"chains must be one for each motion, chain the first, got {len(chains)}")
    mechanism_of([chain, *chains])  # of one kind
    return Trajectory(
        chain, times, provenance=made_by, recipe=made,
        status=status if status.ndim else int(status), chains=chains,
        **beyond, **_read_events(data, chain.n, many),
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


def _read_events(data: dict[str, Any], n: int, many: tuple[int, ...]) -> dict[str, Any]:
    """Return the instants of each event and the states there, by the names of `Trajectory`."""
    found: dict[str, list[Any]] = {name: [] for name in EVENTS}
    for k in takewhile(lambda k: f"t_events_{k}" in data, count()):
        sizes = data.get(f"t_events_{k}_sizes", np.array(len(data[f"t_events_{k}"])))
        whole = sizes.dtype.kind == "i" and sizes.shape == many and np.all(sizes >= 0)
        for name in EVENTS:
            values = _checks.array(f"{name}_{k}", data[f"{name}_{k}"])
            width = () if name == "t_events" else (n,)
            if not whole or values.shape != (sizes.sum(), *width):
                raise ValueError(f"{name}_{k} must have as many rows as t_events_{k}_sizes says")
            found[name].append(np.split(values, np.cumsum(sizes)[:-1]) if many else values)
    return found


def _read_recipe(given: Any, chain: Chain, many: tuple[int, ...]) -> Recipe | None:
    """Return how the steps of a saved trajectory were taken, if that is known."""
    if given is None:
        return None
    method, settings = given["method"], {"rtol": 1.0, "atol": 1.0, "dt": None} | given["settings"]
    drives = {name: _read_drive(given[name]) for name in NAMES}
    if drives["pivot_acceleration"] is not None and chain.base is not None:
        raise ValueError("pivot_acceleration must be None for a chain on a cart")
    for (name, drive), width in zip(drives.items(), ((chain.n,), (), (2,)), strict=True):
        if isinstance(drive, (Signal, Function)) or (drive is None and width == (2,)):
            continue
        values = _checks.array(name, drive)
        if values.shape not in (width, (*many, *width)):
            raise ValueError(
                f"{name} must have the shape {width}, or a row for each motion, got {values.shape}"
            )
        drives[name] = values if values.ndim else float(values)
    return Recipe(method, check_settings(method, **settings), **drives)


def _read_drive(given: Any) -> Any:
    """Return a drive as `_plain` wrote it; a function has only its name left."""
    if not isinstance(given, dict):
        return given
    kept = cast("dict[str, Any]", given)
    if "signal" in kept:
        return Signal(**kept["signal"])
    return Function(None, str(kept["function"]))
