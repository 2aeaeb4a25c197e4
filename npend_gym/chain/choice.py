"""A chain as users give one: the object itself, its parameters, a preset's name, or a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any, cast

import numpy as np

from npend_gym import _checks, _files
from npend_gym.chain.model import Chain
from npend_gym.chain.presets import PRESETS

_OR = "must be an npend_gym.Chain, a dict as its as_dict() gives, or "
_RULE = f"one of {', '.join(PRESETS)}, or a JSON file with a chain's parameters"


def as_chain(value: Any) -> Chain:
    """Return the chain that `value` describes.

    Parameters
    ----------
    value : Chain, mapping, str or path
        A chain, its parameters as `Chain.as_dict` gives them, a name for `Chain.preset`, or a JSON
        file with these parameters, such as the ``fit.json`` of `npend identify`.

    Raises
    ------
    TypeError, ValueError
        If it is none of them, the file cannot be read, or a parameter breaks its rule.

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
    if isinstance(value, (str, Path)):
        return Chain.from_dict(chain_parameters(value, f"chain {_OR}"))
    raise TypeError(f"chain {_OR}{_RULE}; got {_checks.show(value)}")


def chain_parameters(path: str | Path, rule: str = "must be ") -> dict[str, Any]:
    """The chain of a JSON file, as `Chain.from_dict` takes it.

    Raises
    ------
    ValueError
        If there is no such file, or it is no JSON object; the message begins with `rule`.
    """
    try:
        return _files.parse_json(_files.read_text(Path(path)))
    except FileNotFoundError as error:
        shown = _checks.show(str(path))
        raise ValueError(f"{rule}{_RULE}; got {shown}, and there is no such file") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"{rule}{_RULE}; {path} cannot be read: {reason}") from error


def preset_name(chain: Chain) -> str | None:
    """Return the name of the preset that equals `chain`, or None.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.chain import preset_name
    >>> preset_name(Chain.acrobot())
    'acrobot'
    """
    return next((name for name in PRESETS if Chain.preset(name) == chain), None)


def plain_keywords(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords that JSON can hold: chains as dicts, arrays as lists, enumerations as names.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.chain import plain_keywords
    >>> plain_keywords({"chain": Chain.uniform(1), "dt": 0.1})["dt"]
    0.1
    """

    def plain(value: Any, name: str = "") -> Any:
        if name == "chain" and isinstance(value, (str, Path)) and value not in PRESETS:
            return as_chain(value).as_dict()
        if isinstance(value, Chain):
            return value.as_dict()
        if isinstance(value, Mapping):
            return plain_keywords(cast("Mapping[str, Any]", value))
        if isinstance(value, (tuple, list)):
            return [plain(one, name) for one in cast("list[Any]", value)]
        if isinstance(value, (np.ndarray, np.generic)):
            return plain(value.tolist(), name)
        if isinstance(value, Enum):
            return value.name
        # JSON has no infinity: `Chain.as_dict` writes None, too
        return None if name == "gear" and value in (math.inf, -math.inf) else value

    return {name: plain(value, name) for name, value in keywords.items()}
