"""One motion, under all conditions that `simulate` knows."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.adaptive import Motion
from npend_gym.physics.arguments import check_limits, check_torque
from npend_gym.physics.driving import Drive, Signal, drive_of
from npend_gym.physics.events import Watch, Watched, watched
from npend_gym.physics.integration import (
    RODS_PER_CALL,
    check_fixed_steps,
    check_times,
    count_steps,
    ended_rod,
)
from npend_gym.physics.kernels.dynamics import AnyArrays, arrays_of
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_frames
from npend_gym.physics.pivot import Pivot, check_pivot
from npend_gym.physics.springs import Springs, axial_start, check_springs, check_vibrations
from npend_gym.physics.trajectory import AXIAL, OF_PIVOT, Integration, Trajectory

_NOWHERE = np.zeros((0, 0))  # steps are not recorded


class Conditions(NamedTuple):
    """Under which conditions chains move: arguments of `simulate`, not yet checked."""

    torque: Any = None
    pivot_acceleration: Any = None
    cart_mass: float | None = None
    force: Any = 0.0
    rail_damping: float = 0.0
    pivot_velocity: ArrayLike = 0.0
    stiffness: ArrayLike | None = None
    axial_damping: ArrayLike = 0.0
    stretch: ArrayLike | None = None
    stretch_rate: ArrayLike | None = None
    events: Any = None

    @property
    def beyond_torque(self) -> list[str]:
        """Names of the conditions other than the torque that are given."""
        plain = Conditions()._asdict()
        given = self._asdict()
        return [name for name in given if name != "torque" and not _same(given[name], plain[name])]


def _same(given: Any, usual: float | None) -> bool:
    return given is usual if usual is None else np.ndim(given) == 0 and given == usual


class _Start(NamedTuple):
    """A motion at its beginning: the chain as kernels take it, and the parts of its state."""

    rods: AnyArrays
    theta: FloatArray
    omega: FloatArray
    place: FloatArray  # of the pivot where it moves, or how far the rods are stretched
    rate: FloatArray
    names: tuple[str, ...]  # of place and rate in a trajectory

    @property
    def state(self) -> FloatArray:
        return np.concatenate([self.theta, self.place, self.omega, self.rate])


def is_law(value: Any) -> bool:
    """Return whether an argument says how a quantity changes in time."""
    return isinstance(value, Signal) or callable(value)


def simulate_one(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    settings: dict[str, float],
    given: Conditions,
) -> Trajectory:
    """Return one motion; see `simulate`."""
    n = check_chain(chain).n
    start = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    check_limits(*start)
    times = check_times(times, n)
    events = watched(given.events, chain)
    torque = _checks.vector(
        "torque", check_torque(None if is_law(given.torque) else given.torque, n), n
    )
    pivot, drive = _driven(n, torque, given)
    springs = check_springs(
        chain, given.stiffness, given.axial_damping, given.stretch, given.stretch_rate, pivot
    )
    if springs is not None:
        if not drive.constant:
            raise ValueError("torque must be constant with stiffness, got a function or a Signal")
        check_vibrations(chain, springs, float(times[-1] - times[0]))
        place, rate = axial_start(chain, springs, *start, torque, given.stretch, given.stretch_rate)
        begun = _Start(springs.arrays(chain, 1), *start, place, rate, AXIAL)
    elif pivot.moves:
        rods = arrays_of(chain.repeated(1), pivot.base)
        begun = _Start(rods, *start, np.zeros(2), np.array(pivot.velocity), OF_PIVOT)
    else:
        begun = _Start(arrays_of(chain.repeated(1)), *start, np.zeros(0), np.zeros(0), ())
    drive.begin(float(times[0]), *start)
    times, frames, made = _integrated(begun, times, drive, events, settings)
    method = "dop853" if "rtol" in settings else "rk4"
    return _trajectory(
        chain, times, frames, begun, pivot, springs,
        made | {
            "provenance": provenance(
                {"method": method, **settings, "torque": torque.tolist(), "pivot": pivot.as_dict()}
                | ({} if springs is None else {"springs": springs.as_dict()})
                | drive.as_dict()
            ),
            "integration": Integration(method, torque, settings) if drive.constant else None,
        },
    )  # fmt: skip


def _driven(n: int, torque: FloatArray, given: Conditions) -> tuple[Pivot, Drive]:
    """Return how the pivot moves, and what acts on the chain in the course of time."""
    force, acceleration = given.force, given.pivot_acceleration
    if is_law(force) and given.cart_mass is None:
        raise ValueError("force acts on the cart: cart_mass must be given with it, got a law alone")
    pivot = check_pivot(
        (0.0, 0.0) if is_law(acceleration) else acceleration, given.cart_mass,
        0.0 if is_law(force) else force, given.rail_damping, given.pivot_velocity,
    )  # fmt: skip
    drive = drive_of(
        n, n + 2 * pivot.moves, given.torque if is_law(given.torque) else torque,
        force if is_law(force) else pivot.force, acceleration if is_law(acceleration) else None,
    )  # fmt: skip
    return pivot, drive


def _integrated(
    begun: _Start,
    times: FloatArray,
    drive: Drive,
    events: list[Watched],
    settings: dict[str, float],
) -> tuple[FloatArray, FloatArray, dict[str, Any]]:
    """Return the times, the states there, and what else a trajectory keeps."""
    n = begun.theta.size
    if "rtol" in settings:
        tolerances = settings["rtol"], settings["atol"], settings.get("dt", math.inf)
        ends = float(times[0]), float(times[-1])
        return _followed(
            Motion(begun.rods, begun.state, drive, *tolerances, ends, n), times, events
        )
    if not drive.constant or events:
        raise ValueError(
            'method must be "dop853" with events, and with torques, forces or accelerations that '
            'change in time, got "rk4"'
        )
    forces = drive.fixed[:n]
    if begun.names == OF_PIVOT:
        forces = np.concatenate([forces, [drive.fixed[n], 0.0]])
    return times, _by_rk4(begun, times, forces, **settings), {}


def _trajectory(
    chain: Chain,
    times: FloatArray,
    frames: FloatArray,
    begun: _Start,
    pivot: Pivot,
    springs: Springs | None,
    made: dict[str, Any],
) -> Trajectory:
    n, half = chain.n, frames.shape[1] // 2
    columns = slice(n), slice(n, half), slice(half, half + n), slice(half + n, None)
    theta, place, omega, rate = (frames[:, part].copy() for part in columns)
    # no names: rigid rods, pivot at rest
    beyond: dict[str, Any] = dict(zip(begun.names, (place, rate), strict=False))
    return Trajectory(chain, times, theta, omega, pivot=pivot, springs=springs, **beyond, **made)


def _followed(
    motion: Motion, times: FloatArray, events: list[Watched]
) -> tuple[FloatArray, FloatArray, dict[str, Any]]:
    """Integrate by DOP853, until the last of the times or the first terminal event."""
    frames, counts = np.empty((times.size, motion.state.size)), np.zeros(3)
    frames[0], watch = motion.state, Watch(events, motion.n)
    for span, states, steps, counted in motion.segments(times, kept=bool(events)):
        frames[span] = states
        counts += counted
        end = None if steps is None else watch.look(steps)
        if end is not None:
            before = times < end.time
            times = np.append(times[before], end.time)
            frames = np.concatenate([frames[: times.size - 1], [end.state]])
            break
    made = {"counts": counts.astype(np.int64), "motion": motion}
    return times, frames, made | watch.as_dict()


def _by_rk4(begun: _Start, times: FloatArray, torque: FloatArray, dt: float) -> FloatArray:
    """Return the state at each time, a row each, by steps no longer than `dt`."""
    n, chain, state = begun.theta.size, begun.rods, begun.state
    steps = count_steps(times, dt)
    frames = np.empty((times.size, state.size))
    frames[0] = state
    progress, scratch = np.array([1, 0, 0]), new_rk4_scratch(state.size // 2)
    while progress[0] < times.size:
        progress[2] = max(1, RODS_PER_CALL // n)
        sound = rk4_frames(state, times, steps, progress, torque, chain, scratch, frames, _NOWHERE)
        check_fixed_steps(sound, state[:n], times, int(progress[0]), dt, ended_rod(chain))
    return frames
