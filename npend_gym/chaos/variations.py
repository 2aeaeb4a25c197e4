"""Tangent vectors: small changes of the start, carried along a motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.arguments import check_limits, check_settings
from npend_gym.physics.integration import check_times
from npend_gym.physics.replay import Replay, replay
from npend_gym.physics.sensitivities import carry, rods_of
from npend_gym.theory.modes import decay_rate

# Longest step times the fastest mode's frequency, or the rate of the fastest decay: vectors follow
# these, but the motion itself may not, and at rest would allow any step.
_LONGEST = 0.5
_MOST = 10**8  # parts of a motion


def tangents(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    vectors: FloatArray,
    *,
    rtol: float = 1e-11,
    steps: int = 256,
) -> Iterator[tuple[slice, FloatArray]]:
    """Carry tangent vectors along a motion, exactly through the steps of the integrator.

    A vector takes O(n) operations a step. Between two iterations `vectors` stands at the end of the
    last step, where it may be normalised, or made orthogonal, in place.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    times : ndarray, shape (T,)
        Instants [s]; the motion starts at the first, which is not yielded.
    vectors : ndarray, shape (D, 2n)
        Changes of (theta, omega) at the start, float64; it is overwritten.
    rtol : float
        Relative tolerance of the motion's steps, in which the absolute one is a hundredth of it.
    steps : int
        Of the motion, in one iteration, at most.

    Yields
    ------
    slice, ndarray of shape (F, D, 2n)
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
    motion = motion_of(chain, theta, omega, times, rtol)
    size = motion.state.size
    if vectors.ndim != 2 or vectors.shape[1] != size or vectors.dtype != np.float64:
        raise ValueError(
            f"vectors must be float64 of shape (D, {size}), got {vectors.dtype} {vectors.shape}"
        )
    return carry(motion, rods_of(motion), vectors, steps=_checks.count("steps", steps))


def motion_of(
    chain: Chain, theta: ArrayLike, omega: ArrayLike, times: ArrayLike, rtol: float = 1e-11
) -> Replay:
    """Return the motion along which tangent vectors are carried; arguments as for `tangents`."""
    n = check_chain(chain).n
    state = np.concatenate([_checks.vector("theta", theta, n), _checks.vector("omega", omega, n)])
    check_limits(state[:n], state[n:])
    rate = fastest_rate(chain)
    if np.any(chain.damping) or np.any(chain.drag):
        rate = max(rate, decay_rate(chain, chain.damping, chain.drag))
    settings = check_settings("dop853", rtol, 0.01 * rtol, _LONGEST / rate)
    instants, none = check_times(times, n), np.zeros(n)
    return replay("dop853", chain.repeated(1), state, instants, none, settings)


def loses_energy(chain: Chain) -> bool:
    """Return whether damping, drag or dry friction takes energy from the chain."""
    return chain.has_drag or bool(np.any(chain.damping) or np.any(chain.friction))


def fastest_rate(chain: Chain) -> float:
    """Return the angular frequency [rad/s] of the fastest normal mode; 1 rad/s without gravity."""
    return theory.fastest_frequency(check_chain(chain)) or 1.0


def count_parts(chain: Chain, duration: float, step: float) -> int:
    """Return how many steps a duration [s] has, of `step` radians of the fastest mode.

    Raises
    ------
    ValueError, TypeError
        If the duration is no positive number, or has more than 10^8.
    """
    duration, rate = _checks.positive_number("duration", duration), fastest_rate(chain)
    if duration * rate > _MOST * step:
        raise ValueError(
            f"duration must be at most {_MOST * step / rate:g} s for this chain, got {duration:g}: "
            f"its fastest mode swings {rate / (2.0 * np.pi):.3g} times a second"
        )
    return int(np.ceil(duration / (step / rate)))


def describe(chain: Chain, state: FloatArray) -> dict[str, Any]:
    """Return a chain and a start (theta, omega) as the record of what made a result keeps them."""
    theta, omega = np.split(state, 2)
    return {"chain": chain.as_dict(), "theta": theta.tolist(), "omega": omega.tolist()}
