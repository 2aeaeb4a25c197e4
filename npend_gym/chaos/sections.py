"""Poincare sections: the states in which a rod passes an angle, again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_chain
from npend_gym.chaos.variations import count_parts, describe
from npend_gym.physics import Trajectory, simulate

_STEP = 0.05  # rad of the fastest mode, between two looks at the sign
_RESOLUTION = 1e-13  # s, of an instant
_LOOKS = 1000  # in one simulation


@dataclass(frozen=True, eq=False)
class Section:
    """The states of a motion in which a rod passes an angle in one direction.

    Attributes
    ----------
    times : ndarray, shape (K,)
        Instants [s].
    theta : ndarray, shape (K, n)
        Angles [rad] there, from -pi to below pi.
    omega : ndarray, shape (K, n)
        Angular velocities [rad/s] there.
    provenance : dict
        What made it: versions and arguments.
    """

    times: FloatArray
    theta: FloatArray
    omega: FloatArray
    provenance: dict[str, Any]


def poincare_section(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    rod: int = 0,
    angle: float = 0.0,
    direction: int = 1,
    rtol: float = 1e-10,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Section:
    """Return the states in which a rod passes an angle, whole turns aside, in one direction.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods. It is no point of the section.
    duration : float
        How long the motion is followed [s].
    rod : int
        Whose angle it is, counted from 0 at the pivot; -1 is the last.
    angle : float
        Of the rod [rad], from the downward vertical.
    direction : {1, -1}
        1: the rod's angular velocity is positive there; -1: negative.
    rtol : float
        Relative tolerance of the motion's steps, in which the absolute one is a hundredth of it.
    progress : callable
        Wraps the iteration over parts of the duration, for a progress bar.

    Returns
    -------
    Section

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the rod never passes the angle.
    IntegrationError
        If the motion diverges.

    Notes
    -----
    Instants are located to 1e-13 s. Two passages nearer to each other than a hundredth of the
    fastest mode's period may be missed, where a rod turns back just after the angle.

    A section of two rods, of one energy and with one direction, is a plane in which regular motion
    draws curves, and chaos fills areas (M. Henon and C. Heiles, Astron. J. 69, 1964).
    """
    n = check_chain(chain).n
    rod = _checks.count("rod", rod, low=-n, high=n - 1)
    angle = _checks.number("angle", angle)
    if direction not in (1, -1):
        raise ValueError(f"direction must be 1 or -1, got {_checks.show(direction)}")
    looks = count_parts(chain, duration, _STEP)
    state = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    made_by = provenance(
        describe(chain, np.concatenate(state))
        | {
            "duration": float(duration),
            "rod": rod,
            "angle": angle,
            "direction": direction,
            "rtol": rtol,
        }
    )
    times = np.linspace(0.0, duration, looks + 1)
    found: list[_Passage] = []
    for first in progress(range(0, looks, _LOOKS)):
        instants = times[first : first + _LOOKS + 1]
        path = simulate(chain, *state, instants, rtol=rtol, atol=0.01 * rtol)
        ahead = path.theta[:, rod] - angle
        side, near = direction * np.sin(ahead), np.cos(ahead) > 0.0  # not half a turn away
        passed = (side[:-1] < 0.0) & (side[1:] >= 0.0) & near[1:]
        found += [_passage(path, int(k), rod, angle, rtol) for k in np.flatnonzero(passed)]
        state = path.theta[-1], path.omega[-1]
    if not found:
        raise ValueError(
            f"rod {rod} does not pass the angle {angle:g} rad within {duration:g} s in the "
            f"direction {direction}: choose another angle, or follow the motion for longer"
        )
    instants, theta, omega = (np.array(each) for each in zip(*found, strict=True))
    return Section(instants, (theta + np.pi) % (2.0 * np.pi) - np.pi, omega, made_by)


class _Passage(NamedTuple):
    """A point of a section."""

    time: float
    theta: FloatArray
    omega: FloatArray


def _passage(path: Trajectory, k: int, rod: int, angle: float, rtol: float) -> _Passage:
    """Return the point between instants k and k + 1 of a motion."""

    def state(after: float) -> tuple[FloatArray, FloatArray]:
        if after == 0.0:
            return path.theta[k], path.omega[k]
        times = [0.0, after]
        end = simulate(path.chain, path.theta[k], path.omega[k], times, rtol=rtol, atol=0.01 * rtol)
        return end.theta[-1], end.omega[-1]

    def side(after: float) -> float:
        return float(np.sin(state(after)[0][rod] - angle))

    step = float(path.times[k + 1] - path.times[k])
    # another integration than the path's: at the end it may be just before the angle still
    after = brentq(side, 0.0, step, xtol=_RESOLUTION) if side(0.0) * side(step) < 0.0 else step
    return _Passage(float(path.times[k]) + float(after), *state(float(after)))
