"""Nonlinear normal modes: the periodic motions that grow out of the modes of small oscillation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_hung
from npend_gym.chaos.continuation import (
    EXACT,
    Constraint,
    ContinuationError,
    OrbitShooting,
    between,
    family,
)
from npend_gym.chaos.variations import record
from npend_gym.physics import Trajectory, accelerations, mass_matrix, simulate
from npend_gym.physics.arguments import loses_energy

MAX_RODS = 100
_NEUTRAL = 1e-4  # how far from 1 the size of a multiplier of a stable orbit may be, by rounding
_SMALL = 0.02  # rad: where the family starts, on the normal mode


@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A motion that repeats itself: released from rest, at rest again after half the period.

    Attributes
    ----------
    chain : Chain
    mode : int
        Normal mode from which the orbit comes; 0 is the slowest.
    theta : ndarray, shape (n,)
        Angles of the release from rest [rad].
    period : float
        In s.
    energy : float
        Above hanging at rest [J].
    amplitude : float
        The largest of the angles of the release [rad].
    multipliers : ndarray of complex, shape (2n - 2,)
        Factors by which small changes of the orbit grow in a period, the largest first: eigenvalues
        of the monodromy matrix. Two of them are 1 on every such orbit and are left out: for a
        change along the orbit, and for a change to the next orbit of the family.
    closure : float
        Largest distance from the start after one period, in angles [rad] and in angular velocities
        over the mode's frequency.
    provenance : dict
        How it was made: versions and arguments.
    """

    chain: Chain
    mode: int
    theta: FloatArray
    period: float
    energy: float
    amplitude: float
    multipliers: NDArray[np.complex128]
    closure: float
    provenance: dict[str, Any]

    @property
    def stable(self) -> bool:
        """Whether no multiplier is larger than 1: neighbours stay near, to first order."""
        return bool(np.all(np.abs(self.multipliers) < 1.0 + _NEUTRAL))

    def motion(self, samples: int = 101) -> Trajectory:
        """Return one period of the motion, at this many instants."""
        times = np.linspace(0.0, self.period, _checks.count("samples", samples, low=2))
        return simulate(self.chain, self.theta, 0.0, times, rtol=EXACT, atol=0.01 * EXACT)


def periodic_orbits(
    chain: Chain,
    mode: int,
    *,
    amplitudes: ArrayLike | None = None,
    energies: ArrayLike | None = None,
    progress: Callable[[Iterable[float]], Iterable[float]] = iter,
) -> list[PeriodicOrbit]:
    """Return nonlinear normal modes: orbits of the family that a normal mode continues into.

    Parameters
    ----------
    chain : Chain
        Of at most 100 rods, without damping, drag and friction, with all links hanging.
    mode : int
        The normal mode from which to start, from 0, the slowest, to n - 1.
    amplitudes : array_like, shape (K,)
        Amplitudes of the orbits: the largest angle of the release from rest [rad], increasing and
        below pi.
    energies : array_like, shape (K,)
        In place of `amplitudes`: energies above hanging at rest [J], increasing.
    progress : callable
        Wraps the iteration over the orbits that are wanted, for a progress bar.

    Returns
    -------
    list of PeriodicOrbit
        One for each amplitude or energy.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    ContinuationError
        If the family has no orbit of that amplitude or energy, or cannot be followed so far.

    Notes
    -----
    Orbits are found by shooting: Newton's method for rest after half the period, with
    the exact derivatives of `Trajectory.sensitivities`. The family is followed by its arc length
    (Peeters, Viguie, Serandour, Kerschen and Golinval, Mech. Syst. Signal Process. 23, 2009). Such
    orbits come back because the equations are the same when time runs backwards.

    Where a multiple of the orbit's frequency meets the frequency of a faster mode, the family may
    turn back. The search then continues at larger energies; in the gap there are no orbits. If
    several orbits have the same amplitude, the first one is returned. Small changes grow by the
    largest multiplier in a period, and so do rounding errors: `closure` is about that times 1e-16.

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> (orbit,) = chaos.periodic_orbits(Chain.uniform(2), 0, amplitudes=[0.5])
    >>> round(orbit.period, 4), orbit.closure < 1e-9
    (2.6495, True)
    """
    n = _checks.count("n", check_hung(chain, "periodic_orbits").n, high=MAX_RODS)
    mode = _checks.count("mode", mode, low=0, high=n - 1)
    if loses_energy(chain):
        raise ValueError(
            f"chain must have no damping, drag and friction, with which none repeats, got {chain}"
        )
    if chain.gravity == 0.0 or np.any(chain.lift <= 0.0):
        raise ValueError("chain must hang, with every link's centre of mass below its joint")
    name, wanted = _check_wanted(amplitudes, energies)
    frequencies, shapes = theory.normal_modes(chain)
    shooting = OrbitShooting(chain, float(frequencies[mode]))
    by_energy = name == "energies"

    def size(x: FloatArray) -> float:
        return shooting.energy(x)[0] if by_energy else float(np.abs(x[:-1]).max())

    pairs = _follow(shooting, shapes[:, mode], size, float(wanted[0]))
    orbits: list[PeriodicOrbit] = []
    before, after = next(pairs)
    for value in progress(wanted.tolist()):
        while size(after) < value:
            before, after = next(pairs)
        if size(before) > value:
            raise ContinuationError(
                f"the family of mode {mode} has no orbit for {value:g} of {name}: it turns back in "
                f"a resonance with a faster mode, and goes on from {size(before):.4g}"
            )
        reaches = shooting.of_energy(value) if by_energy else _of_amplitude(before, after, value)
        orbits.append(_orbit(shooting, mode, between(shooting, before, after, reaches)))
    return orbits


def _of_amplitude(before: FloatArray, after: FloatArray, wanted: float) -> Constraint:
    """Return the constraint that an orbit between two has an amplitude.

    The first rod to get there is released at that angle.
    """
    angles, ahead = np.abs(before[:-1]), np.abs(after[:-1])
    fractions = np.full(angles.size, np.inf)
    there = ahead >= wanted
    fractions[there] = (wanted - angles[there]) / (ahead - angles)[there]
    rod = int(np.argmin(fractions))
    gradient = np.zeros(before.size)
    gradient[rod] = np.sign(after[rod])
    return lambda x: (float(gradient @ x) - wanted, gradient)


def _follow(
    shooting: OrbitShooting, shape: FloatArray, size: Callable[[FloatArray], float], first: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Return the pairs of orbits of the family that begins with a small motion of this shape."""
    small = _SMALL
    while size(np.append(small * shape, 1.0)) > 0.25 * first:
        small *= 0.5
    guess, tangent = np.append(small * shape, 1.0), np.append(shape, 0.0)
    tangent /= np.linalg.norm(tangent)
    x = shooting.solve(guess, lambda at: (float(tangent @ (at - guess)), tangent))
    if x is None:
        raise ContinuationError("no periodic orbit is found near the normal mode")
    return family(shooting, x, tangent)


def _orbit(shooting: OrbitShooting, mode: int, x: FloatArray) -> PeriodicOrbit:
    """The periodic orbit through `x`, from one period of its motion."""
    chain, n, theta, period = shooting.chain, shooting.n, x[:-1], shooting.period(x)
    path = simulate(chain, theta, 0.0, [0.0, period], rtol=EXACT, atol=0.01 * EXACT)
    scale = np.append(np.ones(n), np.full(n, shooting.frequency))
    states = np.concatenate([path.theta, path.omega], axis=1) / scale
    monodromy = path.sensitivities(()).A[-1] * scale / scale[:, None]
    # changes of the start across the flow (0, alpha) that keep the energy: those along the flow,
    # and those of the energy, have the multiplier 1
    ends = accelerations(chain, theta, 0.0)
    lost = np.zeros((2 * n, 2))
    lost[n:, 0], lost[:n, 1] = ends, mass_matrix(chain, theta) @ ends
    across = np.linalg.qr(lost, mode="complete")[0][:, 2:]
    reduced: FloatArray = across.T @ monodromy @ across
    multipliers: NDArray[np.complex128] = np.asarray(np.linalg.eigvals(reduced), np.complex128)
    return PeriodicOrbit(
        chain, mode, theta, period, shooting.energy(x)[0],
        float(np.abs(theta).max()), multipliers[np.abs(multipliers).argsort()[::-1]],
        float(np.abs(states[1] - states[0]).max()),
        record(chain, np.append(theta, np.zeros(n)), mode=mode),
    )  # fmt: skip


def _check_wanted(
    amplitudes: ArrayLike | None, energies: ArrayLike | None
) -> tuple[str, FloatArray]:
    """Return which of the two is given, and its values, increasing and positive."""
    if (amplitudes is None) == (energies is None):
        raise ValueError("give either amplitudes or energies, and not both")
    name = "energies" if amplitudes is None else "amplitudes"
    wanted = _checks.array(name, energies if amplitudes is None else amplitudes)
    if wanted.ndim != 1 or wanted.size == 0 or np.any(np.diff(wanted, prepend=0.0) <= 0.0):
        shown = _checks.show(wanted.tolist())
        raise ValueError(f"{name} must be a list of increasing positive numbers, got {shown}")
    if energies is None and wanted[-1] >= np.pi:
        raise ValueError(
            f"amplitudes must be below pi, at which a rod stands upright, got {wanted[-1]:g}"
        )
    return name, wanted
