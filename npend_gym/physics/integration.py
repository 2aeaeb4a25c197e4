"""What every integration in time checks: its instants, and whether it can go on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.arguments import check_rtol, loses_energy
from npend_gym.physics.kernels.link_terms import SpringArrays
from npend_gym.physics.kernels.methods import METHODS
from npend_gym.physics.kernels.solver import STUCK, Problem, Solver

MAX_BYTES = 2**33  # of the angles and velocities of a trajectory
_MAX_STEPS = 10**12  # between two times
_LONG, _LATE = 1e9, ", or count the time from the start of the motion"  # s
_NO_LENGTH = ", or a rod has no length left"  # what else may stop the motion of springs
# Rods times steps in one compiled call, after which Ctrl-C is heard: of a motion a sixth of a
# second, of motions in packs and of measurements a quarter
RODS_PER_CALL, RODS_PER_PACK_CALL = 125_000, 50_000


class IntegrationError(RuntimeError):
    """The integration cannot continue: the state diverged, or the tolerance is out of reach."""


def check_times(times: ArrayLike, n: int) -> FloatArray:
    """Return the instants of trajectories that have `n` coordinates in all, shape (T,)."""
    instants = _checks.array("times", times)
    if instants.ndim != 1 or instants.size == 0 or np.any(np.diff(instants) <= 0.0):
        raise ValueError(
            f"times must be a list of increasing instants, got {_checks.show(instants)}"
        )
    if 16 * n * instants.size > MAX_BYTES:
        raise ValueError(
            f"times must hold at most {MAX_BYTES // (16 * n)} instants for {n} "
            f"coordinates in all, got {instants.size}: simulate them in segments"
        )
    return instants


def count_steps(times: FloatArray, dt: float) -> NDArray[np.int64]:
    """Return the number of steps up to each time from the one before; 1 at the first."""
    intervals = np.diff(times, prepend=times[0])
    if float(intervals.max()) / dt > _MAX_STEPS:
        raise ValueError(f"dt must make at most {_MAX_STEPS:g} steps between two times, got {dt:g}")
    steps = np.maximum(1, np.ceil(intervals / dt - 1e-9)).astype(np.int64)
    resolved = np.spacing(np.maximum(np.abs(times), np.abs(times - intervals)))
    if np.any((steps > 1) & (intervals < steps * resolved)):
        raise ValueError(
            f"dt must be at least {resolved.max():g} s, the resolution of numbers as large as "
            f"these times, got {dt:g}: count the time from the start of the motion"
        )
    return steps


def diverged(interval: FloatArray, dt: float, *, springs: bool = False) -> IntegrationError:
    """Return the error that steps of at most `dt` diverged in an interval."""
    since, until = interval
    return IntegrationError(
        f"the state diverged between t = {since:g} s and {until:g} s: dt = {dt:g} is too long for "
        f'this chain; shorten it or use method "dop853"' + _NO_LENGTH * springs
    )


def check_going(
    lanes: tuple[Solver, Problem], status: FloatArray, n: int, members: slice | None = None
) -> None:
    """Raise an error where a motion of `n` rods that `drive_one` or `drive_many` takes is stuck."""
    solver, problem = lanes
    width = status.size // 2
    instants, which = solver.clock[width : 2 * width], ""
    check_angles(solver.y[: n * width], float(instants.max()))
    if np.any(status[:width] == STUCK):
        k = int(np.argmin(status[:width]))
        if members is not None:
            which = f" for motion {min(members.start + k, members.stop - 1)}"
        if not problem.rtol:
            raise IntegrationError(
                f"the step from t = {instants[k]:g} s on{which} has no solution: dt is too long "
                'for this chain; shorten it or use method "dop853"'
            )
        raise IntegrationError(
            f"no step is small enough at t = {instants[k]:g} s{which} with rtol = "
            f"{problem.rtol:g} and atol = {problem.atol:g}: loosen them, or check the state and "
            "parameters"
            + _LATE * bool(abs(instants[k]) > _LONG)
            + _NO_LENGTH * isinstance(problem.chain, SpringArrays)
        )


def check_angles(theta: FloatArray, time: float) -> None:
    """Raise an error where rods have turned so often that sines lose digits."""
    if np.any(np.abs(theta) > MAX_ANGLE):
        raise IntegrationError(
            f"a rod has turned by more than {MAX_ANGLE:g} rad soon after t = {time:g} s: "
            "where a torque drives it faster and faster, check the sign of its feedback; a motion "
            "that is right continues in segments, each begun with the last angles less whole turns"
        )


def check_settings(method: str, rtol: float, atol: float, dt: float | None) -> dict[str, float]:
    """Return those of the settings that `method` takes."""
    if not METHODS[_checks.choice("method", method, (*METHODS,))].adaptive:
        if dt is None:
            raise ValueError(
                f'dt must be given with method "{method}": the longest step in seconds'
            )
        return {"dt": _checks.positive_number("dt", dt)}
    longest = {} if dt is None else {"dt": _checks.positive_number("dt", dt)}
    return {"rtol": check_rtol(rtol), "atol": _checks.positive_number("atol", atol), **longest}


def check_method(method: str, chains: Sequence[Chain], accelerated: object) -> None:
    """Refuse chains and a pivot's acceleration for which a method is not made."""
    if not METHODS[method].conservative:
        return
    for chain in chains:
        if loses_energy(chain):
            raise ValueError(
                f'damping, friction and drag must be zero with method "{method}", which is for '
                f'chains that keep their energy, got {chain!r}: use method "dop853"'
            )
    if accelerated is not None:
        raise ValueError(
            f'pivot_acceleration must be None with method "{method}", which is for a pivot at '
            'rest or a cart: use method "dop853"'
        )
