"""The file that keeps a trajectory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.arguments import check_settings, check_states
from npend_gym.physics.pivot import check_pivot
from npend_gym.physics.springs import check_springs
from npend_gym.physics.trajectory import AXIAL, EVENTS, MAX_BYTES, OF_PIVOT, Integration, Trajectory


def write_trajectory(motion: Trajectory, path: Path) -> None:
    """Write `motion` to `path` as an npz archive, whole or not at all."""
    if path.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {path}; to_csv(path) writes text")
    made = motion.integration
    about = json.dumps(
        {
            "chain": motion.chain.as_dict(),
            "chains": [chain.as_dict() for chain in motion.chains],
            "pivot": motion.pivot.as_dict(),
            "springs": motion.springs and motion.springs.as_dict(),
            "provenance": motion.provenance,
            "integration": made and made._replace(torque=made.torque.tolist())._asdict(),
        }
    )
    names = ("times", "theta", "omega", *OF_PIVOT, *AXIAL)
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


def write_csv(motion: Trajectory, path: Path) -> None:
    """Write `motion` to `path` as a CSV file, whole or not at all."""
    if motion.theta.ndim > 2:
        raise ValueError(f"to_csv writes one motion, got {len(motion)}: trajectory[k].to_csv(path)")
    columns = {"theta": motion.theta, "omega": motion.omega}
    if motion.integration is not None and np.any(motion.integration.torque):
        columns["tau"] = np.broadcast_to(motion.integration.torque, motion.theta.shape)
    names = ["time", *(f"{name}{k}" for name in columns for k in range(motion.chain.n))]
    table = np.column_stack([motion.times, *columns.values()]).tolist()
    with _files.replacing(path) as file:
        for row in (names, *table):
            file.write(",".join(map(str, row)) + "\n")  # floats as repr


def read_trajectory(path: Path) -> Trajectory:
    """Return the trajectory in `path`, or raise a ValueError that says what is wrong with it."""
    try:
        return _read(path)
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"path must name a trajectory made by save(); {path}: {error}") from error


def _read(path: Path) -> Trajectory:
    """Return the trajectory in an npz archive, every part of it checked."""
    data = _files.read_arrays(path, 2 * MAX_BYTES)
    about = _files.parse_json(str(data["about"]))
    times, theta, omega = (_checks.array(name, data[name]) for name in ("times", "theta", "omega"))
    chain = Chain.from_dict(about["chain"])
    shape = (times.size, chain.n)
    if times.ndim != 1 or theta.shape[-2:] != shape or omega.shape != theta.shape:
        raise ValueError(f"theta and omega must have the shape {shape}, or (B, *{shape})")
    if not isinstance(about["provenance"], dict):
        raise TypeError("its provenance must be a dict")
    made_by = cast("dict[str, Any]", about["provenance"])
    pivot = check_pivot(**about["pivot"])
    given: dict[str, Any] = about.get("springs") or {}
    springs = check_springs(chain, **given)
    beyond: dict[str, Any] = {}
    for names, width in ((OF_PIVOT, 2 * pivot.moves), (AXIAL, chain.n * (springs is not None))):
        for name in names if width else ():
            beyond[name] = _checks.array(name, data[name])
            if beyond[name].shape != (*theta.shape[:-1], width):
                raise ValueError(f"{name} must have the shape {(*theta.shape[:-1], width)}")
    made = _read_integration(about.get("integration"), chain.n)
    events: dict[str, Any] = {name: _read_events(data, name) for name in EVENTS}
    status = data.get("status", np.array(0))
    if status.dtype.kind != "i" or status.shape not in ((), theta.shape[:-2]):
        raise ValueError(f"status must hold an integer for each motion, got shape {status.shape}")
    return Trajectory(
        chain, times, theta, omega, made_by, pivot, springs=springs, integration=made,
        status=status if status.ndim else int(status), **beyond, **events,
        chains=tuple(Chain.from_dict(each) for each in about.get("chains", [])),
    )  # fmt: skip


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


def _read_integration(given: Any, n: int) -> Integration | None:
    """Return how the steps of a saved trajectory were taken, if that is known."""
    if given is None:
        return None
    method, settings = given["method"], {"rtol": 1.0, "atol": 1.0, "dt": None} | given["settings"]
    torque = check_states(n, torque=given["torque"])[0]
    return Integration(method, torque, check_settings(method, **settings))
