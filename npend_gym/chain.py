"""The chain: N point masses on massless rods, hung from a pivot; checked once, immutable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray

MAX_RODS = 1_000_000
MAX_DENSE = 10_000  # rods where matrices (n, n) are wanted: 800 MB each
STANDARD_GRAVITY = 9.81  # m/s^2, the paper's listing


class ChainParameters(NamedTuple):
    """The parameters of many chains side by side: those of `Chain` with a leading axis of B."""

    masses: FloatArray  # (B, n), as all others but gravity
    lengths: FloatArray
    gravity: FloatArray  # (B,)
    damping: FloatArray
    drag: FloatArray
    quadratic_drag: FloatArray

    @property
    def carried_masses(self) -> FloatArray:
        """Mass hanging on each rod [kg], shape (B, n)."""
        return np.cumsum(self.masses[:, ::-1], axis=1)[:, ::-1]

    @property
    def lifting_energy(self) -> FloatArray:
        """As that of `Chain` [J], shape (B,)."""
        gravity = np.where(self.gravity > 0.0, self.gravity, STANDARD_GRAVITY)
        return 2.0 * gravity * _sum(self.lengths * self.carried_masses)


def check_parameter(name: str, value: FloatArray) -> FloatArray:
    """Return the parameter `name` of chains, refused where it is not positive, or not zero or more.

    Raises
    ------
    ValueError
        If an entry has the wrong sign.
    """
    must_be_positive = "masses" in name or "lengths" in name
    return (_checks.positive if must_be_positive else _checks.at_least_zero)(name, value)


def _sum(terms: FloatArray) -> Any:
    """Return the sums along the last axis, added in order: the same bits on every machine."""
    return np.cumsum(terms, axis=-1)[..., -1]


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Chain:
    r"""A planar chain of n point masses on massless rods.

    ::

        pivot  O---------> x          theta_i: angle of rod i from the downward
               |\                     vertical, counter-clockwise positive
               | \  rod 0, l_0
               |  \                   x_i =  sum_{k<=i} l_k sin theta_k
               |th0*  m_0             y_i = -sum_{k<=i} l_k cos theta_k
               v    \
               g     * m_1 ...

    Parameters
    ----------
    masses, lengths : float or array_like, shape (n,)
        Mass of each bob [kg] and length of each rod [m], greater than zero. One number stands for
        every rod; two numbers make a single pendulum.
    gravity : float
        Acceleration of gravity [m/s^2], zero or more.
    damping : float or array_like, shape (n,)
        Viscous damping of each joint [N m s/rad], zero or more: joint j, between rod j-1 and
        rod j, resists with the torque damping_j (omega_j - omega_{j-1}).
    drag, quadratic_drag : float or array_like, shape (n,)
        Resistance of still air on each bob, zero or more: the force
        -(drag_i + quadratic_drag_i \|v_i\|) v_i, v_i being the bob's velocity [N s/m and
        N s^2/m^2].

    Raises
    ------
    TypeError, ValueError
        If an argument is not numeric, not finite, of the wrong sign or of the wrong shape.
    """

    masses: FloatArray
    lengths: FloatArray
    gravity: float
    damping: FloatArray
    drag: FloatArray
    quadratic_drag: FloatArray

    def __init__(
        self,
        masses: ArrayLike,
        lengths: ArrayLike,
        gravity: float = STANDARD_GRAVITY,
        damping: ArrayLike = 0.0,
        drag: ArrayLike = 0.0,
        quadratic_drag: ArrayLike = 0.0,
    ) -> None:
        m, rods = _checks.array("masses", masses), _checks.array("lengths", lengths)
        n = _rod_count(m, rods)
        object.__setattr__(self, "gravity", _checks.nonnegative_number("gravity", gravity))
        given = {
            "masses": m,
            "lengths": rods,
            "damping": damping,
            "drag": drag,
            "quadratic_drag": quadratic_drag,
        }
        for name, value in given.items():
            checked = check_parameter(name, _checks.vector(name, value, n))
            checked.flags.writeable = False
            object.__setattr__(self, name, checked)

    @classmethod
    def uniform(
        cls,
        n: int,
        mass: float = 1.0,
        length: float = 1.0,
        gravity: float = STANDARD_GRAVITY,
        damping: float = 0.0,
        drag: float = 0.0,
        quadratic_drag: float = 0.0,
    ) -> Chain:
        """Return a chain of `n` equal rods, each `length` [m] long with a bob of `mass` [kg]."""
        n = _checks.count("n", n, high=MAX_RODS)
        mass = _checks.positive_number("mass", mass)
        length = _checks.positive_number("length", length)
        equal = np.full(n, mass), np.full(n, length)
        return cls(*equal, gravity, damping, drag, quadratic_drag)

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.masses.size

    @cached_property
    def carried_masses(self) -> FloatArray:
        """Mass hanging on each rod, sum_{k>=i} m_k [kg], shape (n,)."""
        return np.cumsum(self.masses[::-1])[::-1]

    @property
    def total_length(self) -> float:
        """Length of the chain when straight [m]."""
        return float(self.lengths.sum())

    @cached_property
    def lifting_energy(self) -> float:
        """Energy that lifts the hanging chain upright, 2 g sum_i l_i sum_{k>=i} m_k [J].

        Without gravity: that on Earth. It is the unit in which environments judge energies.
        """
        return float(self.repeated(1).lifting_energy[0])

    @property
    def has_drag(self) -> bool:
        """Whether air resists any bob."""
        return bool(np.any(self.drag) or np.any(self.quadratic_drag))

    def repeated(self, size: int, **changes: FloatArray) -> ChainParameters:
        """Return the parameters of `size` chains like this one but for some `changes`.

        Parameters
        ----------
        size : int
            Number of chains B.
        **changes : ndarray, shape (B, n), for gravity (B,)
            Parameters by the names of `Chain`.

        Raises
        ------
        ValueError
            If a change breaks the rule of its parameter.
        """
        values = {
            name: check_parameter(name, changes[name])
            if name in changes
            else np.broadcast_to(getattr(self, name), (size, *np.shape(getattr(self, name))))
            for name in ChainParameters._fields
        }
        return ChainParameters(**values)

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain numbers and lists, for a manifest."""
        return {
            "masses": self.masses.tolist(),
            "lengths": self.lengths.tolist(),
            "gravity": self.gravity,
            "damping": self.damping.tolist(),
            "drag": self.drag.tolist(),
            "quadratic_drag": self.quadratic_drag.tolist(),
        }

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chain) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        arrays = (self.masses, self.lengths, self.damping, self.drag, self.quadratic_drag)
        return (self.gravity, *(a.tobytes() for a in arrays))

    def __repr__(self) -> str:
        def brief(a: FloatArray) -> str:
            return f"{a[0]:g}" if np.all(a == a[0]) else np.array2string(a, threshold=6)

        air = f", drag={brief(self.drag)}, quadratic_drag={brief(self.quadratic_drag)}"
        return (
            f"Chain(n={self.n}, masses={brief(self.masses)}, lengths={brief(self.lengths)}, "
            f"gravity={self.gravity:g}, damping={brief(self.damping)}"
            f"{air if self.has_drag else ''})"
        )


def check_chain(value: Any) -> Chain:
    """Return `value`, refused where it is no Chain."""
    if not isinstance(value, Chain):
        raise TypeError(f"chain must be a npend_gym.Chain, got {_checks.show(value)}")
    return value


def _rod_count(masses: FloatArray, lengths: FloatArray) -> int:
    """Return n, where scalars follow the other argument."""
    for name, value in (("masses", masses), ("lengths", lengths)):
        if value.ndim > 1 or value.size == 0:
            raise ValueError(
                f"{name} must be one number or a list with an entry for each rod, "
                f"got shape {value.shape}"
            )
        _checks.count(f"the number of {name}", value.size, high=MAX_RODS)
    if masses.ndim and lengths.ndim and masses.size != lengths.size:
        raise ValueError(
            f"masses and lengths must have an entry for each rod, "
            f"got {masses.size} masses and {lengths.size} lengths"
        )
    return max(masses.size, lengths.size)
