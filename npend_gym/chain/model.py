"""The chain: N links hung from a pivot, point masses on massless rods unless said otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, cast  # noqa: F401  in comments, which dataclasses do not read

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._faces import MethodFromAbove
from npend_gym.chain import parameters
from npend_gym.chain.cart import Cart, as_base
from npend_gym.chain.parameters import (
    FRICTION_SPEED,
    MECHANISM,
    STANDARD_GRAVITY,
    ChainParameters,
)
from npend_gym.chain.presets import NamedChains


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Chain(NamedChains):
    r"""A planar chain of n links: point masses on massless rods, or rigid bodies.

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
        Mass of each link [kg] and its length from joint to joint [m], greater than zero. One
        number stands for every link; two numbers make a single pendulum.
    gravity : float
        Acceleration of gravity [m/s^2], zero or more.
    damping : float or array_like, shape (n,)
        Viscous damping of each joint [N m s/rad], zero or more: joint j, between rod j-1 and
        rod j, resists with the torque damping_j (omega_j - omega_{j-1}).
    drag, quadratic_drag : float or array_like, shape (n,)
        Resistance of still air on each bob (the far end of each link), zero or more: the force
        -(drag_i + quadratic_drag_i \|v_i\|) v_i, v_i being the bob's velocity [N s/m and
        N s^2/m^2].
    centres : float or array_like, shape (n,), optional
        Distance of each link's centre of mass from its upper joint, along the link [m]; it may be
        negative or exceed the length. By default it is at the end: a bob.
    inertias : float or array_like, shape (n,)
        Moment of inertia of each link about its centre of mass [kg m^2], zero or more.
    friction : float or array_like, shape (n,)
        Dry friction of each joint [N m], zero or more: the torque -friction_j u / sqrt(1 + u^2),
        u = (omega_j - omega_{j-1}) / friction_speed_j.
    friction_speed : float or array_like, shape (n,)
        Speed below which dry friction fades [rad/s], greater than zero.
    armature : float or array_like, shape (n,)
        Inertia of each joint's motor as the joint sees it [kg m^2], zero or more: gear^2 times the
        inertia of the rotor.
    gear : float or array_like, shape (n,)
        Turns of the rotor for one turn of the joint, not zero, negative where it turns backwards.
        The motor of joint j stands on link j-1 and has the kinetic energy armature_j ((1/gear_j -
        1) omega_{j-1} + omega_j)^2 / 2. Infinite, or None: as MuJoCo's `armature`, where the rotor
        itself does not turn with link j-1.
    stiffness : float or array_like, shape (n,), optional
        Stiffness of rods that stretch [N/m], greater than zero. They are massless springs between
        point masses; `lengths` are without load. A link with inertia slides along its own axis on
        its spring, in its upper joint. By default rods are rigid: the limit of stiff springs.
    axial_damping : float or array_like, shape (n,)
        Viscous damping of such rods along their length [N s/m], zero or more.
    base : Cart, optional
        The cart that carries the pivot. By default the pivot is at rest.

    Raises
    ------
    TypeError, ValueError
        If an argument is not numeric, not finite, of the wrong sign or of the wrong shape.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> Chain(masses=[1.0, 0.5], lengths=[1.0, 0.4], damping=0.01)
    Chain(n=2, masses=[1.  0.5], lengths=[1.  0.4], gravity=9.81, damping=0.01)
    >>> Chain.uniform(3).total_length
    3.0
    >>> Chain.preset("acrobot").n
    2
    """

    masses: FloatArray
    lengths: FloatArray
    gravity: float
    damping: FloatArray
    drag: FloatArray
    quadratic_drag: FloatArray
    centres: FloatArray
    inertias: FloatArray
    friction: FloatArray
    friction_speed: FloatArray
    armature: FloatArray
    gear: FloatArray
    stiffness: FloatArray | None
    axial_damping: FloatArray
    base: Cart | None

    @_checks.names_keywords
    def __init__(
        self,
        masses: ArrayLike,
        lengths: ArrayLike,
        gravity: float = STANDARD_GRAVITY,
        damping: ArrayLike = 0.0,
        drag: ArrayLike = 0.0,
        quadratic_drag: ArrayLike = 0.0,
        *,
        centres: ArrayLike | None = None,
        inertias: ArrayLike = 0.0,
        friction: ArrayLike = 0.0,
        friction_speed: ArrayLike = FRICTION_SPEED,
        armature: ArrayLike = 0.0,
        gear: ArrayLike | None = np.inf,
        stiffness: ArrayLike | None = None,
        axial_damping: ArrayLike = 0.0,
        base: Cart | None = None,
    ) -> None:
        n = parameters.rod_count(masses, lengths)
        object.__setattr__(self, "gravity", _checks.nonnegative_number("gravity", gravity) + 0.0)
        given = {
            "masses": masses,
            "lengths": lengths,
            "damping": damping,
            "drag": drag,
            "quadratic_drag": quadratic_drag,
            "centres": lengths if centres is None else centres,
            "inertias": inertias,
            "friction": friction,
            "friction_speed": friction_speed,
            "armature": armature,
            "axial_damping": axial_damping,
        }
        if stiffness is not None:
            given["stiffness"] = stiffness
        vectors = {name: _checks.vector(name, value, n) for name, value in given.items()}
        for name, value in (vectors | {"gear": parameters.gear_ratios("gear", gear, (n,))}).items():
            checked = parameters.check_parameter(name, value)
            checked += 0.0  # -0.0 becomes 0.0: equal chains have the same bytes
            object.__setattr__(self, name, _frozen(checked))
        object.__setattr__(self, "base", as_base(base))
        self.repeated(1).check()
        if stiffness is None:
            object.__setattr__(self, "stiffness", None)
        if stiffness is None and np.any(self.axial_damping):
            raise ValueError(
                "axial_damping is that of rods that stretch: stiffness must be given with it, "
                f"got {_checks.show(self.axial_damping.tolist())}"
            )

    to_mjcf = MethodFromAbove("npend_gym.export.mjcf:to_mjcf")  # type: ClassVar[Any]
    from_mjcf = MethodFromAbove("npend_gym.export.read_mjcf:from_mjcf", static=True)  # type: ClassVar[Any]
    from_urdf = MethodFromAbove("npend_gym.export.read_urdf:from_urdf", static=True)  # type: ClassVar[Any]
    to_urdf = MethodFromAbove("npend_gym.export.urdf:to_urdf")  # type: ClassVar[Any]
    to_sdf = MethodFromAbove("npend_gym.export.sdf:to_sdf")  # type: ClassVar[Any]
    to_usd = MethodFromAbove("npend_gym.export.usd:to_usd")  # type: ClassVar[Any]
    _repr_html_ = MethodFromAbove("npend_gym.render.chain_drawing:chain_html")  # type: ClassVar[Any]

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.masses.size

    @property
    def coordinates(self) -> int:
        """Number of coordinates: n angles, the position of a cart, n stretches of springs."""
        return self.n * (1 if self.stiffness is None else 2) + (self.base is not None)

    @property
    def is_hung(self) -> bool:
        """Whether rigid rods hang from a pivot at rest: there are no springs and no cart."""
        return self.stiffness is None and self.base is None

    @cached_property
    def has_bobs(self) -> bool:
        """Whether the links are point masses on massless rods, without rotors."""
        return bool(self.repeated(1).has_bobs[0])

    @cached_property
    def is_ideal(self) -> bool:
        """Whether the chain `has_bobs` and has no dry friction."""
        return self.repeated(1).is_ideal

    @cached_property
    def carried_masses(self) -> FloatArray:
        """Mass hanging on each rod, sum_{k>=i} m_k [kg], shape (n,)."""
        return _frozen(np.cumsum(self.masses[::-1])[::-1].copy())

    @cached_property
    def lift(self) -> FloatArray:
        """Static moment h_i = m_i c_i + l_i sum_{k>i} m_k [kg m]: torque -g h sin theta."""
        return _frozen(self.repeated(1).lift[0].copy())

    @property
    def is_uniform(self) -> bool:
        """Whether the chain has equal point masses on equal massless rods."""
        equal = np.ptp(self.masses) == 0.0 and np.ptp(self.lengths) == 0.0
        return bool(equal and np.all(self.has_bobs))

    @property
    def total_length(self) -> float:
        """Length of the chain when straight [m]."""
        return float(self.lengths.sum())

    @cached_property
    def lifting_energy(self) -> float:
        """Energy that lifts the hanging chain upright, 2 g sum_i abs(h_i) with `lift` h [J].

        Without gravity, the value on Earth. Environments measure energies in this unit.
        """
        return float(self.repeated(1).lifting_energy[0])

    @property
    def has_drag(self) -> bool:
        """Whether air resists any bob."""
        return self.repeated(1).has_drag

    def repeated(self, size: int, **changes: FloatArray) -> ChainParameters:
        """Return the parameters of `size` chains like this one, except for `changes`.

        Parameters
        ----------
        size : int
            Number of chains B.
        **changes : ndarray, shape (B, n), for gravity (B,)
            Parameters by the names of `Chain`. If only lengths change, centres of mass at the ends
            of rods stay there.

        Raises
        ------
        TypeError, ValueError
            If a name is unknown, or a change is not finite, has the wrong shape, or breaks the
            rule of its parameter.
        """
        own = {name: np.asarray(getattr(self, name))[None] for name in ChainParameters._fields}
        if size == 1 and not changes:
            return ChainParameters(**own)
        values = {name: np.broadcast_to(row, (size, *row.shape[1:])) for name, row in own.items()}
        return ChainParameters(**values).changed(changes)

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain numbers and lists, for JSON: `from_dict` reads them.

        Parameters from `centres` on are left out where they equal those of an ideal chain. An
        infinite gear ratio is None.
        """
        shown = (*parameters.SIMPLE_FIELDS, *self.repeated(1).beyond_ideal())
        plain = {name: np.asarray(getattr(self, name)).tolist() for name in shown}
        if "gear" in plain:
            plain["gear"] = [None if np.isinf(one) else one for one in plain["gear"]]
        if self.stiffness is not None:
            plain["stiffness"] = self.stiffness.tolist()
            plain["axial_damping"] = self.axial_damping.tolist()
        return plain if self.base is None else {**plain, "base": self.base.as_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Chain:
        """Return the chain that `as_dict` described; it accepts any keywords of `Chain`.

        Raises
        ------
        TypeError, ValueError
            If `values` is not a mapping, a key is missing or unknown, or a value breaks its rule.
        """
        return cls(**parameters.check_keys(values))

    def hung(self) -> Chain:
        """Return this chain with rigid rods on a pivot at rest: no springs, no cart."""
        own = self.as_dict()
        return Chain.from_dict({name: own[name] for name in own if name not in MECHANISM})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chain) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __getstate__(self) -> dict[str, Any]:  # without what is cached
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:  # copies of arrays can be written to
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                _frozen(cast("FloatArray", value))
            object.__setattr__(self, name, value)

    def _key(self) -> tuple[object, ...]:
        springs = self.stiffness is not None and self.stiffness.tobytes()
        rods = (values.tobytes() for values in self.repeated(1))
        return (*rods, springs, self.axial_damping.tobytes(), self.base)

    def __repr__(self) -> str:
        def brief(a: FloatArray) -> str:
            return f"{a[0]:g}" if np.all(a == a[0]) else np.array2string(a, threshold=6)

        shown = {"masses": self.masses, "lengths": self.lengths}
        shown |= {"gravity": np.array([self.gravity]), "damping": self.damping}
        if self.has_drag:
            shown |= {"drag": self.drag, "quadratic_drag": self.quadratic_drag}
        shown |= {name: getattr(self, name) for name in self.repeated(1).beyond_ideal()}
        if self.stiffness is not None:
            shown |= {"stiffness": self.stiffness, "axial_damping": self.axial_damping}
        texts = [f"{name}={brief(value)}" for name, value in shown.items()]
        texts += [] if self.base is None else [f"base={self.base}"]
        return f"Chain(n={self.n}, {', '.join(texts)})"


def _frozen(values: FloatArray) -> FloatArray:
    values.flags.writeable = False
    return values


def check_chain(value: Any) -> Chain:
    """Return `value`; raise an error if it is not a Chain."""
    if not isinstance(value, Chain):
        raise TypeError(f"chain must be an npend_gym.Chain, got {_checks.show(value)}")
    return value


def check_hung(value: Any, what: str) -> Chain:
    """Return a chain of rigid rods on a pivot at rest, the only ones that `what` is defined for.

    Raises
    ------
    TypeError, ValueError
        If `value` is no chain, or has springs or a cart.
    """
    chain = check_chain(value)
    if not chain.is_hung:
        raise ValueError(
            f"{what} is defined for rigid rods on a pivot at rest: chain must have no stiffness "
            f"and no base, as `chain.hung()` has none, got {chain!r}"
        )
    return chain
