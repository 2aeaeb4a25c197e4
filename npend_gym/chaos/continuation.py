"""Families of periodic motions, followed from one orbit to the next by shooting.

A conservative chain released from rest comes to rest again only on special orbits, which then
swing between two such places for ever: backwards is as good as forwards. The conditions of rest
after half the period are n equations for the n angles of the release and the period; what they
leave free is the place in the family.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics import accelerations, mass_matrix, simulate
from npend_gym.physics.energy import potential_energy

Constraint = Callable[[FloatArray], tuple[float, FloatArray]]  # zero where met, and its gradient

EXACT = 1e-14  # relative tolerance of the orbits that are wanted: as exact as can be
_RTOL, _CLOSED = 1e-10, 1e-9  # of those on the way
_ITERATIONS = 5  # a step that needs more is too long
_FIRST, _LONGEST, _SHORTEST = 0.05, 0.2, 1e-4  # steps in angles [rad] and period over 2 pi / omega
_ASIDE, _BEND = 0.3, 0.97  # of a step: how far from the tangent, and cosine of its turn, at most
_POINTS = 1000
_BEFORE = (0.7, 0.85)  # of the energy at which a family turns back: where it is extrapolated from
_BEYOND = np.arange(1.02, 1.51, 0.02)  # of the same: where it is looked for again
_FAR = 0.3  # from the extrapolation, at most


class ContinuationError(RuntimeError):
    """A family of periodic orbits cannot be followed to the requested orbit."""


class OrbitShooting:
    """The equations of one family. An orbit is x = (angles of the release, period / T0).

    Parameters
    ----------
    chain : Chain
        Conservative.
    frequency : float
        Of the normal mode [rad/s]: T0 = 2 pi / frequency.
    """

    def __init__(self, chain: Chain, frequency: float) -> None:
        self.chain: Chain = chain
        self.n: int = chain.n
        self.frequency: float = frequency

    def period(self, x: FloatArray) -> float:
        """Return the period [s] of the orbit `x`."""
        return float(x[-1]) * 2.0 * np.pi / self.frequency

    def energy(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the energy of the orbit `x` [J], and its derivatives, (n + 1,)."""
        theta = x[:-1]
        slopes = -mass_matrix(self.chain, theta) @ accelerations(self.chain, theta, 0.0)
        return float(potential_energy(self.chain, theta)), np.append(slopes, 0.0)

    def of_energy(self, wanted: float) -> Constraint:
        """Return the constraint that an orbit has this energy [J]."""

        def missed(x: FloatArray) -> tuple[float, FloatArray]:
            energy, slopes = self.energy(x)
            return energy / wanted - 1.0, slopes / wanted

        return missed

    def residual(self, x: FloatArray, rtol: float) -> tuple[FloatArray, FloatArray]:
        """Return the velocities after half the period over `frequency`, (n,), and by x (n, n+1)."""
        half = 0.5 * self.period(x)
        path = simulate(self.chain, x[:-1], 0.0, [0.0, half], rtol=rtol, atol=0.01 * rtol)
        by_start = path.sensitivities(()).A[-1, self.n :, : self.n]
        by_time = accelerations(self.chain, path.theta[-1], path.omega[-1])
        columns = [by_start, by_time[:, None] * np.pi / self.frequency]
        return path.omega[-1] / self.frequency, np.concatenate(columns, axis=1) / self.frequency

    def solve(
        self, x: FloatArray, constraint: Constraint, iterations: int = _ITERATIONS
    ) -> FloatArray | None:
        """Return the orbit near `x` that meets `constraint`, or None, by Newton's method."""
        for _ in range(iterations):
            if not (0.0 < x[-1] < 100.0 and np.abs(x).max() < 100.0):
                return None
            errors, x = self._newton(x, constraint, _RTOL)
            if errors < _CLOSED:
                return x
        return None

    def refine(self, x: FloatArray, constraint: Constraint) -> FloatArray:
        """Return the orbit `x` as exactly as rounding allows."""
        best, least = x, np.inf
        for _ in range(_ITERATIONS):
            errors, after = self._newton(x, constraint, EXACT)
            if errors >= 0.5 * least:
                break
            best, least, x = x, errors, after
        return best

    def tangent(self, x: FloatArray) -> FloatArray:
        """Return the direction of the family at `x`, of length 1, shape (n + 1,)."""
        return np.linalg.svd(self.residual(x, _RTOL)[1])[2][-1]

    def _newton(
        self, x: FloatArray, constraint: Constraint, rtol: float
    ) -> tuple[float, FloatArray]:
        """Return the largest error of `x`, and what one step of Newton's method makes of it."""
        errors, slopes = self.residual(x, rtol)
        missed, gradient = constraint(x)
        errors = np.append(errors, missed)
        change = np.linalg.solve(np.vstack([slopes, gradient]), errors)
        return float(np.abs(errors).max()), x - change


def family(
    shooting: OrbitShooting, x: FloatArray, tangent: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield pairs of neighbouring orbits of increasing energy, from `x` on along the tangent.

    Where the energy turns back, in a resonance with a faster mode, the family is looked for at
    larger ones. The pair that spans the gap is not yielded.

    Raises
    ------
    ContinuationError
        If it is not found there, or steps become too small.
    """
    step, orbits, energies = _FIRST, [x], [shooting.energy(x)[0]]
    while len(orbits) < _POINTS:
        after = _step(shooting, x, tangent, step)
        if after is None:
            step *= 0.5
            if step < _SHORTEST:
                break
            continue
        ahead, tangent = after
        step = min(1.3 * step, _LONGEST)
        if shooting.energy(ahead)[0] > energies[-1]:
            yield x, ahead
            x = ahead
        else:
            x = _lowest(shooting, _beyond(shooting, orbits, energies))
            tangent, step = _uphill(shooting, x), _FIRST
        orbits.append(x)
        energies.append(shooting.energy(x)[0])
    raise ContinuationError(
        f"the family cannot be followed beyond the release from {x[:-1].round(4).tolist()} rad"
    )


def _step(
    shooting: OrbitShooting, x: FloatArray, tangent: FloatArray, step: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return the orbit about a `step` ahead, and the tangent there; None if that is too long."""
    guess = x + step * tangent
    found = shooting.solve(guess, lambda at: (float(tangent @ (at - guess)), tangent))
    if found is None or np.linalg.norm(found - guess) > _ASIDE * step:
        return None
    ahead = shooting.tangent(found)
    turn = float(ahead @ tangent)
    return (found, ahead * np.sign(turn)) if abs(turn) > _BEND else None


def _beyond(shooting: OrbitShooting, orbits: list[FloatArray], energies: list[float]) -> FloatArray:
    """Return an orbit of a family whose energy has turned back, from where it goes on."""
    reached, last = np.array(energies), energies[-1]
    first, second = (int(np.argmin(np.abs(reached - part * last))) for part in _BEFORE)
    slope = (orbits[second] - orbits[first]) / (energies[second] - energies[first])
    for wanted in (last * _BEYOND).tolist():
        guess = orbits[second] + (wanted - energies[second]) * slope
        found = shooting.solve(guess, shooting.of_energy(wanted), iterations=2 * _ITERATIONS)
        if found is not None and np.linalg.norm(found - guess) < _FAR:
            return found
    raise ContinuationError(
        f"the family turns back at the release from {orbits[-1][:-1].round(4).tolist()} rad, in a "
        "resonance with a faster mode, and is not found beyond"
    )


def _uphill(shooting: OrbitShooting, x: FloatArray) -> FloatArray:
    """Return the direction of the family at `x` in which its energy increases."""
    tangent = shooting.tangent(x)
    return tangent * np.sign(shooting.energy(x)[1] @ tangent)


def _lowest(shooting: OrbitShooting, x: FloatArray) -> FloatArray:
    """Return the orbit down the family from `x` after which its energy increases again."""
    tangent, energy = -_uphill(shooting, x), shooting.energy(x)[0]
    while (after := _step(shooting, x, tangent, _FIRST)) is not None:
        ahead, tangent = after
        below = shooting.energy(ahead)[0]
        if below > energy:
            break
        x, energy = ahead, below
    return x


def between(
    shooting: OrbitShooting, x: FloatArray, ahead: FloatArray, constraint: Constraint
) -> FloatArray:
    """Return the orbit between two neighbours that meets `constraint`, as exactly as can be."""
    missed = constraint(x)[0], constraint(ahead)[0]
    guess = x - (ahead - x) * missed[0] / (missed[1] - missed[0])
    found = shooting.solve(guess, constraint, iterations=2 * _ITERATIONS)
    if found is None:
        raise ContinuationError(f"no orbit is found near {guess[:-1].round(4).tolist()} rad")
    return shooting.refine(found, constraint)
