"""The parameters of chains: their rules, and what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray

MAX_RODS = 1_000_000
MAX_DENSE = 10_000  # rods where matrices (n, n) are wanted: 800 MB each
STANDARD_GRAVITY = 9.81  # m/s^2, the paper's listing
FRICTION_SPEED = 0.05  # rad/s, at which dry friction has 0.71 of its torque


class ChainParameters(NamedTuple):
    """The parameters of B chains: the parameters of `Chain`, with a leading axis of length B."""

    masses: FloatArray  # (B, n), as all others but gravity
    lengths: FloatArray
    gravity: FloatArray  # (B,)
    damping: FloatArray
    drag: FloatArray
    quadratic_drag: FloatArray
    centres: FloatArray
    inertias: FloatArray
    friction: FloatArray
    friction_speed: FloatArray
    armature: FloatArray
    gear: FloatArray

    @classmethod
    def ideal(cls, *simple: FloatArray) -> ChainParameters:
        """Return point masses at the ends of massless rods, given their `SIMPLE_FIELDS`."""
        masses, lengths = simple[:2]
        none, speeds = np.zeros_like(masses), np.full_like(masses, FRICTION_SPEED)
        beyond = lengths, none, none, speeds, none, np.full_like(masses, np.inf)
        return cls._make((*simple, *beyond))

    @property
    def has_bobs(self) -> BoolArray:
        """Whether each chain is point masses on massless rods, without rotors, shape (B,)."""
        is_bob = (self.centres == self.lengths) & (self.inertias == 0.0) & (self.armature == 0.0)
        return np.all(is_bob, axis=-1)

    @property
    def is_ideal(self) -> bool:
        """Whether all chains are point masses on massless rods, with no friction and no rotors."""
        return bool(np.all(self.has_bobs)) and not np.any(self.friction)

    @property
    def has_drag(self) -> bool:
        """Whether air resists any bob of any chain."""
        return bool(np.any(self.drag) or np.any(self.quadratic_drag))

    @property
    def carried_masses(self) -> FloatArray:
        """Mass hanging on each rod [kg], shape (B, n)."""
        return np.cumsum(self.masses[..., ::-1], axis=-1)[..., ::-1]

    @property
    def lift(self) -> FloatArray:
        """Static moment of each rod, see `Chain.lift` [kg m], shape (B, n)."""
        carried = self.carried_masses
        below = np.concatenate([carried[..., 1:], np.zeros_like(carried[..., :1])], axis=-1)
        at_the_end = self.centres == self.lengths  # with the bits of the ideal chain
        with_centre = self.masses * self.centres + self.lengths * below
        return np.where(at_the_end, self.lengths * carried, with_centre)

    @property
    def lifting_energy(self) -> FloatArray:
        """Energy that lifts each hanging chain upright [J], shape (B,)."""
        gravity = np.where(self.gravity > 0.0, self.gravity, STANDARD_GRAVITY)
        return 2.0 * gravity * _sum(np.abs(self.lift))

    def changed(self, changes: Mapping[str, FloatArray]) -> ChainParameters:
        """Return the chains with new values of some parameters, by name.

        If only lengths change, centres of mass at the ends of rods stay there.

        Raises
        ------
        TypeError, ValueError
            If a name is unknown, or a change is not finite, has another shape than the parameter,
            or breaks its rule.
        """
        own = self._asdict()
        for name in changes:
            if name not in own:
                raise TypeError(
                    f"chains side by side have no parameter {name!r}{_checks.nearest(name, own)} "
                    f"They have {', '.join(own)}"
                )
        values = own | {
            name: check_rows(name, row, own[name].shape) for name, row in changes.items()
        }
        if "lengths" in changes and "centres" not in changes:
            at_the_end = self.centres == self.lengths
            values["centres"] = np.where(at_the_end, values["lengths"], self.centres)
        return ChainParameters(**values).check()

    def stacked(self) -> FloatArray:
        """Return all parameters in one array, shape (B, 12, n); gravity fills its row."""
        lanes, n = self.masses.shape
        stacked = np.empty((lanes, len(self), n))
        for k, row in enumerate(self):
            stacked[:, k] = row if row.ndim == 2 else row[:, None]
        return stacked

    @classmethod
    def unstacked(cls, rows: FloatArray) -> ChainParameters:
        """Return the parameters from the `rows` that `stacked` returned, shape (B, 12, n)."""
        fields = dict(zip(cls._fields, np.moveaxis(rows, 1, 0), strict=True))
        return cls(**fields | {"gravity": fields["gravity"][:, 0]})

    @property
    def joint_inertia(self) -> FloatArray:
        """Inertia of each link alone, its rotor included, about its joint [kg m^2], (B, n)."""
        return self.inertias + self.masses * self.centres**2 + self.armature

    def beyond_ideal(self) -> list[str]:
        """Return the names of the parameters that differ from those of ideal chains."""
        ideal = ChainParameters.ideal(*self[: len(SIMPLE_FIELDS)])
        fields = zip(self._fields, self, ideal, strict=True)
        return [name for name, own, simple in fields if not np.array_equal(own, simple)]

    def check(self) -> ChainParameters:
        """Return the parameters; raise an error if a link has no inertia about its joint.

        `check_parameter` has the rules for single parameters.

        Raises
        ------
        ValueError
            If inertia about the centre, armature and distance of the centre are all zero.
        """
        if not np.all(self.joint_inertia > 0.0):
            link = int(np.argwhere(self.joint_inertia <= 0.0)[0, 1])
            raise ValueError(
                f"inertias and centres must give each link inertia about its joint, but those of "
                f"link {link} are 0; give it an inertia, an armature or a centre off the joint"
            )
        return self


SIMPLE_FIELDS = ChainParameters._fields[:6]  # those that ideal chains have
MECHANISM = ("stiffness", "axial_damping", "base")  # keywords of `Chain` beyond `ChainParameters`


def check_keys(given: Any) -> Mapping[str, Any]:
    """Return keywords of `Chain`; raise an error for no mapping, or a missing or unknown key."""
    if not isinstance(given, Mapping):
        raise TypeError(f"a chain must be a dict of parameters, got {_checks.show(given)}")
    values = cast("Mapping[str, Any]", given)
    fields = (*ChainParameters._fields, *MECHANISM)
    missing = [f"has no {name!r};" for name in ("masses", "lengths") if name not in values]
    unknown = [
        f"must not have {name!r}{_checks.nearest(name, fields)}"
        for name in values
        if name not in fields
    ]
    for fault in unknown + missing:
        raise ValueError(f"the dict of a chain {fault} its keys are {', '.join(fields)}")
    return values


_POSITIVE = ("masses", "lengths", "friction_speed", "stiffness")  # in the names of parameters


def check_parameter(name: str, value: FloatArray) -> FloatArray:
    """Return the parameter `name` of chains; raise an error for a wrong sign or a wrong zero.

    Raises
    ------
    ValueError
        If an entry breaks the rule of that parameter.
    """
    if "friction_speed" in name and np.any(value <= 0.0):
        raise ValueError(
            f"{name} must be greater than zero, because dry friction needs a speed [rad/s] below "
            f"which it fades ({FRICTION_SPEED} by default), got {_checks.show(value.tolist())}"
        )
    if "gear" in name and np.any(np.abs(value) < _checks.SMALLEST):
        raise ValueError(
            f"{name} must not be zero: a rotor turns gear times as fast as its joint, or is seen "
            f"directly where gear is infinite; got {_checks.show(value.tolist())}"
        )
    if "gear" in name or "centres" in name:
        return value
    must_be_positive = any(word in name for word in _POSITIVE)
    return (_checks.positive if must_be_positive else _checks.at_least_zero)(name, value)


def check_rows(name: str, row: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return a parameter of chains side by side, refused if it breaks its rule."""
    ratios = name == "gear" and getattr(row, "dtype", None) == np.float64  # may be infinite
    infinite = np.isinf(row) if ratios else None
    checked = _checks.array(name, row if infinite is None else np.where(infinite, 1.0, row))
    if checked.shape != shape:
        raise ValueError(
            f"{name} must have the shape {shape}, a row for each chain, got {checked.shape}"
        )
    return check_parameter(name, checked if infinite is None else np.where(infinite, row, checked))


def gear_ratios(name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return gear ratios of `shape`; None and infinity of any sign become infinity."""
    if value is None or (np.isscalar(value) and value == np.inf):
        return np.full(shape, np.inf)
    given = np.array(_checks.unmasked(name, value), dtype=object)
    ends = (None, np.inf, -np.inf)
    # entries of a ragged array are arrays themselves, which `broadcast` refuses
    infinite = [not isinstance(one, np.ndarray) and one in ends for one in given.flat]
    infinite = np.array(infinite, np.bool_).reshape(given.shape)
    if infinite.any():  # errors of the others, without what stands for infinity below
        _checks.array(name, given[~infinite].tolist())
    finite = _checks.broadcast(name, np.where(infinite, 1.0, given).tolist(), shape)
    return np.where(infinite, np.inf, finite)


def rod_count(masses: ArrayLike, lengths: ArrayLike) -> int:
    """Return n, where scalars follow the other argument."""
    masses, lengths = _checks.array("masses", masses), _checks.array("lengths", lengths)
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


def _sum(terms: FloatArray) -> Any:
    """Return the sums along the last axis, added in order: the same bits on every machine."""
    return np.cumsum(terms, axis=-1)[..., -1]
