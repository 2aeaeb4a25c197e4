"""A chain as users give one: the object itself, its parameters, or a preset's name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from npend_gym import _checks
from npend_gym.chain.model import Chain
from npend_gym.chain.presets import PRESETS


def as_chain(value: Any) -> Chain:
    """Return the chain that `value` describes.

    Parameters
    ----------
    value : Chain, mapping or str
        A chain, its parameters as `Chain.as_dict` gives them, or a name for `Chain.preset`.

    Raises
    ------
    TypeError, ValueError
        If it is none of them, or a parameter breaks its rule.

    Examples
    --------
    >>> from npend_gym.chain import as_chain
    >>> as_chain("acrobot").n
    2
    """
    if isinstance(value, Chain):
        return value
    if isinstance(value, Mapping):
        return Chain.from_dict(value)  # pyright: ignore[reportUnknownArgumentType]
    if isinstance(value, str) and value in PRESETS:
        return Chain.preset(value)
    error = ValueError if isinstance(value, str) else TypeError
    raise error(
        "chain must be a npend_gym.Chain, a dict as its as_dict() gives, or one of "
        f"{', '.join(PRESETS)}; got {_checks.show(value)}"
    )


def preset_name(chain: Chain) -> str | None:
    """Return which of PRESETS equals `chain`; None where none does.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.chain import preset_name
    >>> preset_name(Chain.acrobot())
    'acrobot'
    """
    return next((name for name in PRESETS if Chain.preset(name) == chain), None)


def plain_keywords(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords that JSON can hold: chains as dicts, arrays as lists.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.chain import plain_keywords
    >>> plain_keywords({"chain": Chain.uniform(1), "dt": 0.1})["dt"]
    0.1
    """

    def plain(value: Any) -> Any:
        if isinstance(value, Chain):
            return value.as_dict()
        if isinstance(value, Mapping):
            return plain_keywords(cast("Mapping[str, Any]", value))
        if isinstance(value, (tuple, list)):
            return [plain(one) for one in cast("list[Any]", value)]
        return value.tolist() if isinstance(value, np.ndarray) else value

    return {name: plain(value) for name, value in keywords.items()}
