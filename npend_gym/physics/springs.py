"""Rods that stretch: massless springs between the bobs, their start and their energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.equations import accelerations, tensions
from npend_gym.physics.kernels.springs import SpringArrays, spring_arrays
from npend_gym.physics.pivot import Pivot

MAX_VIBRATIONS = 1e9  # along the rods, in the time that is simulated
_DIFFERENCE = 1e-5  # of the time in which the state changes: T' is a difference over that


@dataclass(frozen=True, eq=False)
class Springs:
    """What holds the bobs of a chain whose rods stretch.

    The tension of rod i is stiffness_i stretch_i + axial_damping_i (d/dt) stretch_i, where its
    length is that of the chain plus stretch_i; a negative tension pushes.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        [N/m]
    axial_damping : ndarray, shape (n,)
        [N s/m]
    """

    stiffness: FloatArray
    axial_damping: FloatArray

    def arrays(self, chain: Chain, lanes: int) -> SpringArrays:
        """Return the parameters of `lanes` chains like `chain`, as the kernels take them."""
        return spring_arrays(chain.repeated(lanes), self.stiffness, self.axial_damping)

    def potential_energy(self, chain: Chain, theta: FloatArray, stretch: FloatArray) -> FloatArray:
        """Return the energy of gravity and springs above hanging at rest [J], shape (T,).

        With x the stretch and x_0 = g sum_{k>=i} m_k / k_i that at rest, the terms that are linear
        in x cancel: sum_i k_i (x_i - x_0i)^2 / 2 is left beside the energy of rods of these
        lengths.
        """
        at_rest = chain.gravity * chain.carried_masses / self.stiffness
        in_springs = 0.5 * np.sum(self.stiffness * (stretch - at_rest) ** 2, axis=-1)
        return _energy.potential_energy(stretched(chain, stretch), theta) + in_springs

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as plain lists, ready for JSON."""
        return {
            "stiffness": self.stiffness.tolist(),
            "axial_damping": self.axial_damping.tolist(),
        }


def check_springs(
    chain: Chain,
    stiffness: ArrayLike | None = None,
    axial_damping: ArrayLike = 0.0,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
    pivot: Pivot | None = None,
) -> Springs | None:
    """Return the springs between the bobs of `chain`, or None where its rods are rigid.

    `stretch` and `stretch_rate` are checked by `axial_start`, where there are springs.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, the chain is not one of point masses, or the pivot moves.
    """
    damping = _checks.vector("axial_damping", axial_damping, chain.n)
    if stiffness is None:
        given = {"stretch": stretch, "stretch_rate": stretch_rate}
        given |= {"axial_damping": axial_damping if np.any(damping) else None}
        for name, value in given.items():
            if value is not None:
                raise ValueError(
                    f"{name} is that of rods that stretch: stiffness must be given with it, "
                    f"got {name}={_checks.show(value)}"
                )
        return None
    if pivot is not None and pivot.moves:
        raise ValueError(
            "rods that stretch hang from a pivot at rest: pivot_acceleration and cart_mass must be "
            "left out with stiffness"
        )
    if not chain.is_ideal:
        raise ValueError(
            "stiffness is for point masses: centres, inertias, friction and armature of the chain "
            f"must be left out with it, got {chain!r}"
        )
    k = _checks.vector("stiffness", stiffness, chain.n)
    damping = _checks.at_least_zero("axial_damping", damping)
    return Springs(_checks.positive("stiffness", k), damping)


def check_vibrations(chain: Chain, springs: Springs, duration: float) -> None:
    """Refuse springs so stiff that a motion of this `duration` [s] would never be finished.

    Rods vibrate no faster than sqrt(2 max_i k_i (1/m_i + 1/m_{i-1})), by Gershgorin's circles;
    dampers relax no faster than 2 max_i d_i (1/m_i + 1/m_{i-1}).
    """
    inverse = 1.0 / chain.masses
    both_ends = inverse + np.concatenate([[0.0], inverse[:-1]])
    rate = max(
        float(np.sqrt(2.0 * np.max(springs.stiffness * both_ends))),
        float(2.0 * np.max(springs.axial_damping * both_ends)),
    )
    if rate * duration > 2.0 * np.pi * MAX_VIBRATIONS:
        raise ValueError(
            f"stiffness and axial_damping must make rods vibrate at most {MAX_VIBRATIONS:g} times "
            f"in {duration:g} s, because every vibration takes steps, got "
            f"{_checks.show(springs.stiffness.tolist())} and "
            f"{_checks.show(springs.axial_damping.tolist())}: leave them out, rigid rods are the "
            "limit of stiff springs"
        )


def stretched(chain: Chain, stretch: FloatArray) -> ChainParameters:
    """Return the chain as rigid rods of the lengths that its springs have, one for each state."""
    lengths = chain.lengths + stretch.reshape(-1, chain.n)
    return chain.repeated(len(lengths), lengths=lengths, centres=lengths)


def axial_start(
    chain: Chain,
    springs: Springs,
    theta: FloatArray,
    omega: FloatArray,
    torque: FloatArray,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return stretch [m] and its rate [m/s] at the start, of the shape of `theta`, (..., n).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or a rod has no length left.
    """
    if stretch is None:
        if stretch_rate is not None:
            raise ValueError("stretch must be given with stretch_rate")
        start, rate = slow_start(chain, springs, theta, omega, torque)
    else:
        start = _checks.vector("stretch", stretch, chain.n)
        rate = _checks.vector(
            "stretch_rate", 0.0 if stretch_rate is None else stretch_rate, chain.n
        )
    if np.any(start <= -chain.lengths):
        way_out = "; give stretch, or more stiffness" if stretch is None else ""
        raise ValueError(
            "stretch must leave every rod a length greater than zero at the start, but is "
            f"{_checks.show(start.tolist())} for lengths {_checks.show(chain.lengths.tolist())}"
            + way_out
        )
    return start, rate


def slow_start(
    chain: Chain, springs: Springs, theta: FloatArray, omega: FloatArray, torque: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the stretch and its rate with which springs follow rigid rods, and do not ring.

    They carry the tensions T of rigid rods in the same state: stretch T/k, its rate T'/k. What is
    left of vibration along the rods decreases as 1/k^2.
    """
    tension = tensions(chain, theta, omega, torque)
    alpha = accelerations(chain, theta, omega, torque)
    pace = np.maximum(np.abs(omega), np.sqrt(np.abs(alpha))).max(axis=-1, keepdims=True)
    h = _DIFFERENCE / np.where(pace > 0.0, pace, 1.0)
    after, before = (
        tensions(chain, theta + (s * omega + 0.5 * s * s * alpha), omega + s * alpha, torque)
        for s in (h, -h)
    )
    rate = (after - before) / (2.0 * h) / springs.stiffness
    return (tension - springs.axial_damping * rate) / springs.stiffness, rate


def stretching(chain: Chain, theta: FloatArray, rate: FloatArray) -> FloatArray:
    """Return what stretching at this rate adds to the velocities of bobs [m/s], (T, n, 2)."""
    # sum_k x_k' e_k, as positions are sums of the lengths along the rods
    return _energy.positions(chain.repeated(len(rate))._replace(lengths=rate), theta)
