"""What is drawn at every start of an episode: the `randomize` keyword, checked and laid out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain, ChainParameters, check_parameter
from npend_gym.envs.keywords import CHAIN_KEYWORDS, check_weight
from npend_gym.envs.rows import Setting
from npend_gym.envs.settings import DRAWN
from npend_gym.envs.starts import Draw, DrawFields
from npend_gym.physics.kernels.laws import Parameter
from npend_gym.physics.kernels.link_terms import count_terms

_ONE_NUMBER = ("gravity", *DRAWN)
# Of which less lets a chain turn or brake faster
_ACTIVE_WHERE_LOW = ("lengths", "inertias", "armature", "friction_speed")


class Randomization(NamedTuple):
    """Which numbers are drawn at every start, between which bounds."""

    names: tuple[str, ...]  # one for each number, such as "masses[0]" or "gravity"
    draws: FloatArray  # what compiled code needs of them, (numbers, len(Draw))
    # The chain as made, and chains with all numbers at the ends of their ranges: those that turn
    # and brake fastest are among them
    corners: list[ChainParameters]

    def normalised(self, context: FloatArray) -> FloatArray:
        """Return numbers that were drawn, (..., numbers), within their ranges: -1 to 1."""
        low, high = self.draws[:, Draw.LOW], self.draws[:, Draw.HIGH]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        return np.clip((context - middle) / np.where(half > 0.0, half, 1.0), -1.0, 1.0)

    def ends(self, name: str, value: float) -> tuple[float, float]:
        """Return the ends of the range of one of `DRAWN`, `value` twice without one."""
        if name not in self.names:
            return value, value
        row = self.draws[self.names.index(name)]
        return row[Draw.LOW], row[Draw.HIGH]

    def changed(self, changes: Mapping[str, FloatArray]) -> list[ChainParameters]:
        """Return the corners with changes (B, n), B chains each; refused where one is no task's."""
        lanes = len(next(iter(changes.values())))
        repeated = (
            ChainParameters(*(np.repeat(row, lanes, axis=0) for row in corner))
            for corner in self.corners
        )
        corners = [corner.changed(changes) for corner in repeated]
        low, high = corners[1:3] or corners * 2  # without ranges both are the chain as made
        check_heights(low, high)
        return corners

    @property
    def with_all_features(self) -> ChainParameters:
        """The chain that needs the most of the model."""
        return max(self.corners, key=lambda each: (count_terms(each), count_terms(each, True)))

    @property
    def has_bobs(self) -> bool:
        """Whether every chain is point masses on massless rods."""
        return all(bool(corner.has_bobs[0]) for corner in self.corners)


def check_randomize(given: Any, chain: Chain, settings: Mapping[str, float]) -> Randomization:
    """Check the keyword `randomize` and take it apart.

    `settings` has the values that the environment is made with, of those of `DRAWN` that it has.
    """
    nominal = chain.repeated(1)
    if given is None:
        return Randomization((), np.zeros((0, len(Draw))), [nominal])
    if not isinstance(given, Mapping):
        raise TypeError(
            f'randomize must be a dict such as {{"masses": (0.9, 1.1)}}, got {_checks.show(given)}'
        )
    names: list[str] = []
    rows: list[DrawFields] = []
    lows: dict[str, FloatArray] = {}
    highs: dict[str, FloatArray] = {}
    for name, ends in cast("Mapping[str, Any]", given).items():
        if name not in CHAIN_KEYWORDS and name not in settings:
            raise ValueError(
                f"randomize must have keys among {', '.join((*CHAIN_KEYWORDS, *settings))}; "
                f"got {_checks.show(name)}"
            )
        of_chain = name in CHAIN_KEYWORDS
        value = np.atleast_1d(getattr(chain, name) if of_chain else settings[name])
        low, high = _range(f"randomize[{name!r}]", name, ends, value)
        field = getattr(Parameter if of_chain else Setting, name)
        for rod in range(low.size):
            names.append(name if name in _ONE_NUMBER else f"{name}[{rod}]")
            rows.append(DrawFields(of_chain, field, ROD=rod, LOW=low[rod], HIGH=high[rod]))
        if of_chain:
            shape = (1,) if name == "gravity" else (1, chain.n)
            lows[name], highs[name] = low.reshape(shape), high.reshape(shape)
    draws = np.array(rows).reshape(-1, len(Draw))
    return Randomization(tuple(names), draws, _corners(nominal, lows, highs))


def _range(label: str, name: str, given: Any, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ends of a range, in the unit of the parameter `name`, each as long as `value`."""
    shown = _checks.show(given)
    if isinstance(given, Mapping):
        ends = cast("Mapping[str, Any]", given)
        if set(ends) != {"low", "high"}:
            raise ValueError(
                f'{label} must have the keys "low" and "high", got {_checks.show(list(ends))}'
            )
        low, high = (_checks.broadcast(label, ends[end], value.shape) for end in ("low", "high"))
    else:
        pair: list[Any] = [*cast("Any", given)] if isinstance(given, (tuple, list)) else []
        if len(pair) != 2:
            raise ValueError(
                f"{label} must be a pair (low, high) of factors, or a dict with the values "
                f'"low" and "high", got {shown}'
            )
        factors = [_checks.broadcast(label, end, value.shape) for end in pair]
        for factor in factors:
            _checks.at_least_zero(label, factor)
        if not np.all(np.isfinite(value)) or not np.any(value):
            raise ValueError(
                f"{label} are factors of {_checks.show(value.tolist())}, which changes nothing: "
                f'give values, {{"low": ..., "high": ...}}'
            )
        ends_of = [value * factor for factor in factors]
        low, high = np.minimum(*ends_of), np.maximum(*ends_of)
        if np.any(factors[0] > factors[1]):
            low, high = high, low
    if np.any(low > high):
        raise ValueError(f"{label} must have its low end below its high end, got {shown}")
    for end in (low, high):
        if name in CHAIN_KEYWORDS:
            check_parameter(label, end)
        elif name == "cart_mass":
            _checks.positive(label, end)
        elif name != "amplitude":
            _checks.at_least_zero(label, end)
    return low, high


def _corners(
    nominal: ChainParameters, lows: Mapping[str, FloatArray], highs: Mapping[str, FloatArray]
) -> list[ChainParameters]:
    """Return the chain as made, and chains at the ends of the ranges."""
    _check_joints(nominal, lows, highs)
    corners = [nominal, nominal.changed(lows), nominal.changed(highs)]
    active = dict(highs) | {name: lows[name] for name in _ACTIVE_WHERE_LOW if name in lows}
    n = nominal.masses.shape[1]
    link: NDArray[np.int64] = np.arange(n, dtype=np.int64)
    # Damping turns light links fastest; gravity swings those fastest that carry heavy ones
    patterns: list[BoolArray] = [link < 0, link < n, link % 2 > 0, link % 2 < 1, link > 0, link > 1]
    borne = [name for name in ("masses", "centres") if name in lows]
    kinds = [active]
    if "lengths" in lows and (corners[2].has_drag or np.any(corners[2].friction)):
        for far in patterns[1:]:  # drag brakes long links fastest
            lengths = np.where(far, highs["lengths"], lows["lengths"])
            kinds.append(active | {"lengths": lengths})
    for kind in kinds:
        for heavy in patterns if borne else patterns[:1]:
            weights = {name: np.where(heavy, highs[name], lows[name]) for name in borne}
            corners.append(nominal.changed(kind | weights))
        if "centres" in lows:  # heavy links that hang from their middle swing fast, or upside down
            corners.append(nominal.changed(kind | {"centres": lows["centres"]}))
    check_heights(*corners[1:3])
    return corners


def check_heights(low: ChainParameters, high: ChainParameters) -> None:
    """Raise a ValueError where a chain between two may be higher hanging than standing."""
    joint = np.cumsum(low.lengths, axis=-1) - low.lengths  # height of each, where all stand
    check_weight(
        low.changed({"masses": np.where(low.centres + joint < 0.0, high.masses, low.masses)})
    )


def _check_joints(
    nominal: ChainParameters, lows: Mapping[str, FloatArray], highs: Mapping[str, FloatArray]
) -> None:
    """Raise a ValueError where a draw between good ends could be a bad one."""
    if "gear" in lows and np.any(lows["gear"] * highs["gear"] < 0.0):
        raise ValueError(
            "randomize['gear'] must have ends of one sign, because a gear ratio cannot be zero; "
            f"got {_checks.show([lows['gear'][0].tolist(), highs['gear'][0].tolist()])}"
        )
    if "centres" in lows:
        about_centre = nominal.changed(lows).inertias + nominal.changed(lows).armature
        if np.any((lows["centres"] * highs["centres"] <= 0.0) & (about_centre == 0.0)):
            raise ValueError(
                "randomize['centres'] must keep the centres of links without inertia and armature "
                "off their joints, because nothing else resists a torque; "
                f"got {_checks.show([lows['centres'][0].tolist(), highs['centres'][0].tolist()])}"
            )
