"""Settings as values: motors, sensors, a cart on its rail, and what is drawn at random."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar, cast

import numpy as np
from typing_extensions import Self

from npend_gym import _checks
from npend_gym.chain import ChainParameters
from npend_gym.envs.settings import DRAWN, FIELDS, CartSettings, MotorSettings, SensorSettings

_Class = TypeVar("_Class", bound=type)


def described(name: str, annotation: Any) -> str:
    """Return the lines that describe a setting, in numpydoc's form."""
    about = FIELDS[name].metadata
    choices = getattr(about["rule"], "keywords", {}).get("options")
    kind = "{" + ", ".join(map(repr, choices)) + "}" if choices else annotation
    text = textwrap.fill(about["text"], 88, break_on_hyphens=False)
    return f"    {name} : {kind}\n{textwrap.indent(text, 8 * ' ')}"


def _with_parameters(owner: _Class) -> _Class:
    """Describe the fields of a value in its docstring."""
    if owner.__doc__:  # python -OO has none
        listed = "\n".join(described(each.name, each.type) for each in fields(owner))
        owner.__doc__ = f"{owner.__doc__}\n\n    Parameters\n    ----------\n{listed}\n"
    return owner


class _Value:
    """What the values share: rules, and a text that leaves defaults out."""

    def __post_init__(self) -> None:
        """Check what does not depend on the chain, as keywords are checked."""
        for each in fields(cast("Any", self)):
            value, rule = getattr(self, each.name), each.metadata["rule"]
            value = value.tolist() if isinstance(value, np.ndarray) else value
            value = tuple(cast("Any", value)) if isinstance(value, list) else value
            value = value if rule is None else rule(each.name, value)
            object.__setattr__(self, each.name, value)

    @classmethod
    def of(cls, settings: Any) -> Self:
        """Return those of the fields of `settings` that are its own."""
        return cls(**{each.name: getattr(settings, each.name) for each in fields(cast("Any", cls))})

    @property
    def given(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        own = ((each, getattr(self, each.name)) for each in fields(cast("Any", self)))
        return {each.name: value for each, value in own if value != each.default}

    def __repr__(self) -> str:
        listed = ", ".join(f"{name}={value!r}" for name, value in self.given.items())
        return f"{type(self).__name__}({listed})"


@_with_parameters
@dataclass(frozen=True, kw_only=True, repr=False)
class Motors(_Value, MotorSettings):
    """Motors of an environment, their errors, and pushes: ``gym.make(..., motors=Motors(...))``."""


@_with_parameters
@dataclass(frozen=True, kw_only=True, repr=False)
class Sensors(_Value, SensorSettings):
    """Sensors of an environment, and their errors: ``gym.make(..., sensors=Sensors(...))``."""


@_with_parameters
@dataclass(frozen=True, kw_only=True, repr=False)
class CartOnRail(_Value, CartSettings):
    """A cart that carries the pivot, and its rail: ``gym.make(..., cart=CartOnRail(...))``."""


@dataclass(frozen=True, init=False, repr=False)
class Randomize(Mapping[str, Any]):
    """Ranges of what is drawn at every start of an episode, as the keyword `randomize` has them.

    Parameters
    ----------
    **ranges
        By the name of a parameter of the chain, or of a setting of motors, sensors or cart.

    Examples
    --------
    >>> from npend_gym.envs import Randomize
    >>> Randomize(masses=(0.9, 1.1), torque_noise={"low": 0.0, "high": 0.1})["masses"]
    (0.9, 1.1)
    """

    ranges: Mapping[str, Any]

    def __init__(self, **ranges: Any) -> None:
        for name in ranges:
            _checks.choice("a name in Randomize", name, (*ChainParameters._fields, *DRAWN))
        object.__setattr__(self, "ranges", ranges)

    def __getitem__(self, name: str) -> Any:
        return self.ranges[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.ranges)

    def __len__(self) -> int:
        return len(self.ranges)

    def __repr__(self) -> str:
        return f"Randomize({', '.join(f'{k}={v!r}' for k, v in self.ranges.items())})"


VALUES: dict[str, type[Motors | Sensors | CartOnRail]] = {
    "motors": Motors, "sensors": Sensors, "cart": CartOnRail,
}  # fmt: skip


def unfolded(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords with the fields of `motors`, `sensors` and `cart` in place of these.

    The dicts that JSON makes of values are taken as values. Where all fields stand beside a value,
    as `dataclasses.replace` puts them, the value counts.
    """
    flat = dict(keywords)
    for name, kind in VALUES.items():
        value = flat.pop(name, None)
        if value is None:
            continue
        own = tuple(each.name for each in fields(kind))
        if isinstance(value, Mapping):
            for key in cast("Mapping[str, Any]", value):
                _checks.choice(f"a key of {name}", key, own)
            value = kind(**cast("Mapping[str, Any]", value))
        if not isinstance(value, kind):
            raise TypeError(
                f"{name} must be an npend_gym.envs.{kind.__name__}, or the dict of its fields; "
                f"got {_checks.show(value)}"
            )
        beside = [key for key in own if key in flat]
        repeated = len(beside) == len(own)
        if beside and not repeated:
            raise ValueError(
                f"{beside[0]} cannot be given together with {name}, which holds it: give "
                f"{name}={kind.__name__}({beside[0]}={_checks.show(flat[beside[0]])}, ...)"
            )
        for key in beside:
            del flat[key]
        if kind is CartOnRail:
            if flat.get("base", "cart") != "cart" and not repeated:
                raise ValueError(
                    f'base must be "cart", or left out, where cart is given; got '
                    f"{_checks.show(flat['base'])}"
                )
            flat["base"] = "cart"
        flat |= value.given
    drawn = flat.get("randomize")
    if isinstance(drawn, Randomize):
        flat["randomize"] = dict(drawn)
    elif isinstance(drawn, Mapping) and [*cast("Mapping[str, Any]", drawn)] == ["ranges"]:
        flat["randomize"] = drawn["ranges"]
    return flat
