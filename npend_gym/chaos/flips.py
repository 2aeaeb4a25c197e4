"""When a rod first turns over: the time that maps of chaos show."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._threads import Call, check_threads, share_out
from npend_gym.chain import Chain, check_chain
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.arguments import check_rtol
from npend_gym.physics.energy import total_energy
from npend_gym.physics.equations import States, states_of
from npend_gym.physics.kernels.drive import Flips
from npend_gym.physics.motion import pack_of, packs_of


def flip_times(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    rtol: float = 1e-9,
    threads: int = 1,
    pivot_acceleration: ArrayLike | None = None,
) -> FloatArray:
    """Return when any rod of a chain first passes through upright, for one start or many.

    Parameters
    ----------
    chain : Chain
        A cart starts at rest, and springs with the tensions of rigid rods.
    theta, omega : array_like, shape (n,) or (..., n)
        The starts [rad, rad/s]; one number stands for all rods.
    duration : float
        How long each motion is followed at most [s].
    rtol : float
        Relative tolerance of the steps; the absolute tolerance is a hundredth of it. With 1e-9 the
        energy of a double pendulum is kept to 1e-7 of the lifting energy over 10 s.
    threads : int
        Number of threads that share the starts. Results do not depend on it.
    pivot_acceleration : array_like of shape (2,), optional
        Constant acceleration of the pivot [m/s^2].

    Returns
    -------
    ndarray, shape (...)
        Instants [s]; 0 where a rod starts at half a turn or beyond, NaN where no rod turns over
        within `duration`.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If no step is small enough for the tolerance.

    Notes
    -----
    A start is not integrated if its energy cannot lift any rod to upright, with all other rods as
    low as possible: nothing adds energy. Instants are zeros of the dense solution, found by
    bisection to the resolution of time. A rod that passes upright and comes back within one step is
    found where its angular velocity changes sign once. J. S. Heyl made such maps, "The double
    pendulum fractal" (2008).

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> starts = [[1.0, 1.0], [3.0, 3.0]]
    >>> chaos.flip_times(Chain.uniform(2), starts, duration=10.0).round(4).tolist()
    [nan, 0.5645]
    """
    n = check_chain(chain).n
    states = states_of(chain, theta, omega, pivot_acceleration=pivot_acceleration)
    duration = _checks.positive_number("duration", duration)
    settings = {"rtol": check_rtol(rtol), "atol": 1e-2 * rtol}
    threads = check_threads(threads)
    q, u = (each.reshape(-1, states.mechanism.size) for each in (states.q, states.u))
    states.mechanism.check_vibrations(duration)
    times = np.full(len(q), np.nan)
    over = np.any(np.abs(q[:, :n]) >= np.pi, axis=1)
    times[over] = 0.0
    reaches = np.ones_like(over)
    if chain.stiffness is None and pivot_acceleration is None:  # no energy comes from elsewhere
        lower = np.minimum(chain.lift, 0.0)  # links whose weight is above their joint
        needed = float(2.0 * chain.gravity * (chain.lift - lower + lower.sum()).min())
        reaches = total_energy(chain, q[:, :n], u[:, :n]) >= needed
    followed = np.flatnonzero(~over & reaches)
    loads = np.zeros((followed.size, states.loads.shape[-1]))
    started = States(states.mechanism, q[followed], u[followed], loads)

    def follow(members: slice, call: Call) -> None:
        flips = Flips(n, np.full(WIDTH, np.nan))
        pack_of(started, members, settings).follow(0.0, duration, flips, call)
        times[followed[members]] = flips.instants[: members.stop - members.start]

    if followed.size:
        share_out(packs_of(followed.size), threads, follow)
    return times.reshape(states.q.shape[:-1])
