"""Chains side by side with what carries them and what stretches, as kernels take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters, check_chain
from npend_gym.physics.kernels.link_terms import AnyArrays, Base, terms_of_each
from npend_gym.physics.kernels.member_rows import arrays_of

MAX_VIBRATIONS = 1e9  # along the rods, in the time that is simulated
PIVOT = ("position", "velocity")  # of a cart, or of a pivot that is accelerated
AXIAL = ("stretch", "stretch_rate")  # of springs


class Mechanism(NamedTuple):
    """The parameters of B chains, or of one for all, and of what belongs to them.

    The coordinates of each are theta (n), then the base, then the stretch of its springs (n). A
    cart has one coordinate, a pivot with a prescribed acceleration two.
    """

    parameters: ChainParameters  # (B, n)
    springs: tuple[FloatArray, FloatArray] | None  # stiffness and axial damping, (B, n) each
    base: FloatArray | None  # (len(Base), B); None where the pivot is at rest
    places: int  # coordinates of the base: 0, 1 or 2

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.parameters.masses.shape[1]

    @property
    def pivot_acceleration(self) -> FloatArray | None:
        """Constant acceleration of the first pivot [m/s^2], (2,), if one is prescribed."""
        if self.places != 2 or self.base is None:
            return None
        return self.base[[Base.ACROSS, Base.UP], 0]

    @property
    def size(self) -> int:
        """Number of coordinates of each chain."""
        return self.n + self.places + (self.n if self.springs is not None else 0)

    @property
    def kinds(self) -> list[int]:
        """What tells which kernel each chain has alone; empty where all have the same."""
        if self.springs is not None or self.base is not None or len(self.parameters.masses) == 1:
            return []
        return terms_of_each(self.parameters).tolist()

    def of(self, lanes: NDArray[np.int64]) -> Mechanism:
        """Return the chains of these motions."""
        springs, base = self.springs, self.base
        if len(self.parameters.gravity) == 1:
            if lanes.size == 1 and (base is None or base.shape[1] == 1):
                return self
            lanes = np.zeros_like(lanes)
        return Mechanism(
            ChainParameters(*(np.asarray(each[lanes]) for each in self.parameters)),
            None if springs is None else (springs[0][lanes], springs[1][lanes]),
            None if base is None else base[:, lanes if base.shape[1] > 1 else np.zeros_like(lanes)],
            self.places,
        )

    def arrays(self) -> AnyArrays:
        """Return them in the form that the kernels take, the lane innermost."""
        return arrays_of(self.parameters, self.base, self.springs)

    def axial_rates(self) -> tuple[float, float]:
        """Return bounds of how fast springs vibrate and relax [1/s]; zeros for rigid rods.

        Rods vibrate no faster than sqrt(2 max_i k_i (1/m_i + 1/m_{i-1})), by Gershgorin's circles;
        dampers relax no faster than 2 max_i d_i (1/m_i + 1/m_{i-1}). m_{-1} is that of the cart. Of
        a link that is no bob, the mass that its tip has where it turns about its joint counts too.
        """
        if self.springs is None:
            return 0.0, 0.0
        own = self.parameters
        inverse = np.maximum(1.0 / own.masses, own.lengths**2 / own.joint_inertia)
        above = np.zeros((len(inverse), 1))
        if self.base is not None:
            above = above + self.base[Base.INVERSE_MASS][:, None]
        both_ends = inverse + np.hstack([above, inverse[:, :-1]])
        stiffness, damping = self.springs
        vibrating = float(np.sqrt(2.0 * np.max(stiffness * both_ends)))
        return vibrating, float(2.0 * np.max(damping * both_ends))

    def check_vibrations(self, duration: float) -> None:
        """Refuse springs so stiff that a motion of this `duration` [s] would never be finished."""
        if max(self.axial_rates()) * duration > 2.0 * np.pi * MAX_VIBRATIONS:
            stiffness, damping = (each.tolist() for each in self.springs or ())
            raise ValueError(
                "stiffness and axial_damping must make rods vibrate at most "
                f"{MAX_VIBRATIONS:g} times in {duration:g} s, because every vibration takes steps, "
                f"got {_checks.show(stiffness)} and {_checks.show(damping)}: "
                "leave them out, rigid rods are the limit of stiff springs"
            )


def first_of(chains: Sequence[Chain]) -> Chain:
    """Return the first chain; raise an error if there is none."""
    if not chains:
        raise ValueError("chain must be one npend_gym.Chain or more, got none")
    return check_chain(chains[0])


def mechanism_of(chains: Sequence[Chain], accelerated: FloatArray | None = None) -> Mechanism:
    """Return chains of one kind side by side.

    Parameters
    ----------
    chains : sequence of Chain
        With equally many rods; all with a cart or none, all with springs or none.
    accelerated : ndarray, shape (2,) or (B, 2), optional
        Prescribed acceleration of the pivots, sideways and up [m/s^2].

    Raises
    ------
    ValueError, TypeError
        If one is no chain, or they are not of one kind.
    """
    first = first_of(chains)
    for chain in chains:
        if check_chain(chain).n != first.n:
            raise ValueError(
                f"chains must have the same number of rods, got {first.n} and {chain.n}"
            )
        for name, what in (("stiffness", "springs"), ("base", "a cart")):
            if (getattr(chain, name) is None) != (getattr(first, name) is None):
                raise ValueError(
                    f"chains must all have {what} or none, got {first!r} and {chain!r}"
                )
    parameters = first.repeated(1)
    if len(chains) > 1:
        fields = zip(*(chain.repeated(1) for chain in chains), strict=True)
        parameters = ChainParameters(*(np.concatenate(field) for field in fields))
    springs = base = None
    if first.stiffness is not None:
        stiffness = np.array([chain.stiffness for chain in chains])
        springs = stiffness, np.array([chain.axial_damping for chain in chains])
    if first.base is not None:
        if accelerated is not None:
            raise ValueError(
                "pivot_acceleration must be None for a chain on a cart, because forces move a cart"
            )
        base = np.zeros((len(Base), len(chains)))
        carts = [chain.base for chain in chains if chain.base is not None]
        base[Base.INVERSE_MASS] = [1.0 / cart.mass for cart in carts]
        base[Base.DAMPING] = [cart.damping for cart in carts]
        return Mechanism(parameters, springs, base, 1)
    if accelerated is not None:
        pairs = accelerated.reshape(-1, 2)
        base = np.zeros((len(Base), len(pairs)))
        base[Base.ACROSS], base[Base.UP] = pairs.T
        return Mechanism(parameters, springs, base, 2)
    return Mechanism(parameters, springs, None, 0)


def in_frame_of_pivot(chain: Chain, acceleration: Any) -> Chain:
    """Return a chain under the gravity that it feels where its pivot is accelerated.

    That is known of a constant `acceleration`, two numbers [m/s^2]; else the chain is returned.
    """
    felt = _felt(chain, acceleration)
    if felt is None:
        return chain
    return Chain.from_dict(chain.as_dict() | {"gravity": math.hypot(*felt)})


def hanging_angle(chain: Chain, acceleration: Any) -> float:
    """Return the angle at which a chain hangs under a constant `acceleration` of its pivot [rad].

    See `in_frame_of_pivot`.
    """
    felt = _felt(chain, acceleration)
    return 0.0 if felt is None else math.atan2(*felt)


def _felt(chain: Chain, acceleration: Any) -> tuple[float, float] | None:
    """Return the gravity that is felt [m/s^2], to the right and down, where it is constant."""
    if acceleration is None or callable(acceleration):
        return None
    pair = _checks.array("pivot_acceleration", acceleration)
    return (-float(pair[0]), chain.gravity + float(pair[1])) if pair.shape == (2,) else None


def check_axial_start(
    chain: Chain, stretch: ArrayLike | None, stretch_rate: ArrayLike | None, shape: tuple[int, ...]
) -> tuple[FloatArray, FloatArray] | None:
    """Return stretch [m] and its rate [m/s] at the start as given, of `shape` (..., n), or None.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or rods are rigid.
    """
    given: dict[str, Any] = {"stretch": stretch, "stretch_rate": stretch_rate}
    if chain.stiffness is None:
        for name, value in given.items():
            if value is not None:
                raise ValueError(
                    f"{name} is that of rods that stretch: the chain must have stiffness, got "
                    f"{name}={_checks.show(value)}"
                )
        return None
    if stretch is None:
        if stretch_rate is not None:
            raise ValueError("stretch must be given with stretch_rate")
        return None
    rate = 0.0 if stretch_rate is None else stretch_rate
    return _of_rods("stretch", stretch, shape), _of_rods("stretch_rate", rate, shape)


def _of_rods(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a quantity of each rod, given for all states or for each, as an array of `shape`."""
    given = _checks.array(name, value)
    if given.shape == shape[-1:]:
        given = np.broadcast_to(given, shape)
    return _checks.broadcast(name, given, shape)


def check_lengths(lengths: FloatArray, stretch: FloatArray, *, chosen: bool) -> None:
    """Refuse springs that have no length left at the start, which may be a `chosen` one."""
    if np.any(stretch <= -lengths):
        raise ValueError(
            "stretch must leave every rod a length greater than zero at the start, but is "
            f"{_checks.show(stretch.tolist())} for lengths {_checks.show(lengths.tolist())}"
            + "; give stretch, or more stiffness"
            * chosen
        )
