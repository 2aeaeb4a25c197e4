"""Poincare sections: the states in which a rod passes an angle, again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.chaos.variations import count_parts, record
from npend_gym.physics import simulate
from npend_gym.physics.arguments import check_rtol
from npend_gym.physics.mechanism import AXIAL, PIVOT

_PART = 10.0  # rad of the fastest mode, at least, in one simulation


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
    pivot_acceleration: Any = None,
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
    pivot_acceleration : array_like of shape (2,), Signal or callable, optional
        Acceleration of the pivot [m/s^2], as in `simulate`.

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
    Points are events of `simulate`, located to 1e-12 s. Two passages within a quarter of a step may
    be missed, where a rod turns back just after the angle.

    A section of two rods, of one energy and with one direction, is a plane in which regular motion
    draws curves, and chaos fills areas (M. Henon and C. Heiles, Astron. J. 69, 1964).

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> section = chaos.poincare_section(Chain.uniform(2), [0.5, 0.5], duration=20.0)
    >>> section.theta.shape[1], bool(abs(section.theta[:, 0]).max() < 1e-8)
    (2, True)
    """
    n = check_chain(chain).n
    rod = _checks.count("rod", rod, low=-n, high=n - 1)
    angle = _checks.number("angle", angle)
    if direction not in (1, -1):
        raise ValueError(f"direction must be 1 or -1, got {_checks.show(direction)}")
    direction = int(direction)
    parts = min(100, count_parts(chain, duration, _PART))
    state = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    start = np.concatenate(state)
    more: dict[str, Any] = {"pivot_acceleration": pivot_acceleration}
    given = {"duration": float(duration), "rod": rod, "angle": angle, "direction": direction}
    given["rtol"] = check_rtol(rtol)
    event, times = _Passage(rod % n, angle, direction), np.linspace(0.0, duration, parts + 1)
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for part in progress(range(parts)):
        ends = times[part : part + 2]
        path = simulate(chain, *state, ends, events=event, rtol=rtol, atol=0.01 * rtol, **more)
        found.append((path.t_events[0], path.theta_events[0], path.omega_events[0]))
        state = path.theta[-1], path.omega[-1]
        others = {name: getattr(path, name) for name in (*PIVOT, *AXIAL)}
        more |= {name: each[-1] for name, each in others.items() if each is not None}
    instants, thetas, omegas = (np.concatenate(each) for each in zip(*found, strict=True))
    near = np.cos(thetas[:, rod] - angle) > 0.0  # half a turn away the sine is zero, too
    if not near.any():
        raise ValueError(
            f"rod {rod} does not pass the angle {angle:g} rad within {duration:g} s in the "
            f"direction {direction}: choose another angle, or follow the motion for longer"
        )
    wrapped = (thetas[near] + np.pi) % (2.0 * np.pi) - np.pi
    made_by = record(chain, start, **given, pivot_acceleration=pivot_acceleration)
    return Section(instants[near], wrapped, omegas[near], made_by)


@dataclass(frozen=True)
class _Passage:
    """The event that a rod passes an angle, whole turns aside, or is half a turn away from it."""

    rod: int
    angle: float
    direction: int

    def __call__(self, _t: float, theta: FloatArray, _omega: FloatArray) -> float:
        """Return the sine of the angle that is left."""
        return float(np.sin(theta[self.rod] - self.angle))
