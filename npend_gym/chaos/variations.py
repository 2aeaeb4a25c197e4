"""Tangent vectors: small changes of the start, carried along a motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.integration import check_settings, check_times
from npend_gym.physics.mechanism import in_frame_of_pivot
from npend_gym.physics.motion import Integration
from npend_gym.physics.recipe import described
from npend_gym.physics.sensitivities import carry
from npend_gym.physics.signals import TimeVarying
from npend_gym.physics.start import Start
from npend_gym.physics.substeps import LONGEST_PHASE, fastest_decay, fastest_rate

_MOST = 10**8  # parts of a motion
UNDRIVEN: Mapping[str, Any] = {"torque": None, "force": 0.0, "pivot_acceleration": None}
_FROM_ZERO = np.zeros(1)  # times of a motion whose measure chooses its own


def tangents(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    vectors: ArrayLike,
    *,
    rtol: float = 1e-11,
    steps: int = 256,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> Iterator[tuple[slice, FloatArray]]:
    """Carry tangent vectors along a motion, exactly through the steps of the integrator.

    A vector takes O(n) operations a step. Between two iterations `vectors` stands at the end of the
    last step, where it may be normalised, or made orthogonal, in place.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    times : array_like, shape (T,)
        Instants [s], increasing; the motion starts at the first, which is not yielded.
    vectors : ndarray, shape (D, 2m)
        Changes of all coordinates and their rates at the start, float64; it is overwritten. A list
        or a read-only array is copied, and the copy overwritten.
    rtol : float
        Relative tolerance of the motion's steps; the absolute tolerance is a hundredth of it.
    steps : int
        Largest number of steps of the motion in one iteration.
    torque, force, pivot_acceleration : array_like, Signal or callable, optional
        What drives the chain, as in `simulate`; functions of time alone.

    Yields
    ------
    slice, ndarray of shape (F, D, 2m)
        Which of the instants lie in the steps, and the vectors there.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    FloatingPointError
        If vectors outgrow all bounds in one iteration.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, chaos
    >>> times, vectors, grown = np.linspace(0.0, 1.0, 5), np.eye(4), []
    >>> for _, carried in chaos.tangents(Chain.uniform(2), 0.5, 0.0, times, vectors):
    ...     grown += [*np.linalg.norm(carried, axis=-1).max(axis=-1)]
    >>> np.round(grown, 2).tolist()
    [4.49, 2.19, 5.87, 2.72]
    """
    instants, steps = check_times(times, check_chain(chain).n), _checks.count("steps", steps)
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    motion = motion_of(chain, theta, omega, rtol, drives, instants)
    size = motion.state.size
    own: Any = vectors
    if not isinstance(vectors, np.ndarray) or not vectors.flags.writeable:
        own = _checks.array("vectors", vectors)
    if own.ndim != 2 or own.shape[1] != size or own.dtype != np.float64:
        raise ValueError(
            f"vectors must be float64 of shape (D, {size}), got {own.dtype} {own.shape}"
        )
    if not np.isfinite(own).all():
        raise ValueError(f"vectors must be finite, got {_checks.show(own.tolist())}")
    carried = carry(motion, instants, own, steps=steps)
    return ((where, frames) for where, frames, _ in carried)


def motion_of(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    rtol: float = 1e-11,
    drives: Mapping[str, Any] = UNDRIVEN,
    times: FloatArray = _FROM_ZERO,
    *,
    longest: float = math.inf,
    alone: bool = True,
) -> Integration:
    """Return the motion along which tangent vectors are carried; arguments as for `tangents`.

    A cart starts at rest, and springs with the tensions of rigid rods. No step is longer than
    `longest` [s]. Functions that depend on the state are refused where `alone` is true.
    """
    n, felt = check_chain(chain).n, in_frame_of_pivot(chain, drives["pivot_acceleration"])
    # vectors follow these rates, but the motion itself may not, and at rest would allow any step
    rate = max(fastest_rate(felt), fastest_decay(chain))
    settings = check_settings("dop853", rtol, 0.01 * rtol, min(longest, LONGEST_PHASE / rate))
    start = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    started = Start((chain,), *start, {**drives}, {"stretch": None}, times, settings, one=True)
    motion = started.motion(slice(0, 1), packed=False)
    if alone:
        motion.drives.check_time_alone(float(times[0]), *np.split(motion.state, 2))
    return motion


def count_parts(chain: Chain, duration: float, step: float, name: str = "duration") -> int:
    """Return how many steps a duration [s] has, of `step` radians of the fastest mode.

    Errors call it by its `name`.

    Raises
    ------
    ValueError, TypeError
        If the duration is no positive number, or has more than 10^8.
    """
    duration, rate = _checks.positive_number(name, duration), fastest_rate(chain)
    if duration * rate > _MOST * step:
        raise ValueError(
            f"{name} must be at most {_MOST * step / rate:g} s for this chain, got {duration:g}: "
            f"its fastest mode swings {rate / (2.0 * np.pi):.3g} times a second"
        )
    return max(1, int(np.ceil(duration / (step / rate) - 1e-9)))


def record(chain: Chain, state: FloatArray, **arguments: Any) -> dict[str, Any]:
    """Return the record of what made a result: a chain, its state at the start, and arguments.

    Drives are named among these, unless they have their defaults.
    """
    halves = zip(("theta", "omega"), np.split(state, 2), strict=True)
    start = {name: half[: chain.n].tolist() for name, half in halves}
    named = {name: described(arguments.pop(name, None)) for name in UNDRIVEN}
    arguments |= {name: drive for name, drive in named.items() if drive not in (None, 0.0)}
    return provenance({"chain": chain.as_dict(), **start, **arguments})
