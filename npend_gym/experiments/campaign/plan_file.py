"""A plan from a TOML, YAML or JSON file."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from npend_gym import _checks, _files

_MAX_TEXT = 100_000  # characters of a plan's file


def _toml(text: str) -> Any:
    # in the standard library from 3.11 on; the extra "campaign" brings it to 3.10
    return import_module("tomllib" if sys.version_info >= (3, 11) else "tomli").loads(text)


def _yaml(text: str) -> Any:
    yaml: Any = import_module("yaml")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the other needs 0.1 s for some lines
    try:
        _check_tokens(yaml.scan(text, loader))
        node = yaml.compose(text, loader)
        if isinstance(node, yaml.MappingNode):
            _once([(key.value, value) for key, value in node.value])
        return yaml.load(text, loader)
    except RecursionError:
        raise
    except Exception as error:  # its constructors raise their own kinds for bad dates and such
        raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error


def _check_tokens(tokens: Iterable[Any]) -> None:
    """Refuse aliases, by which a few lines stand for gigabytes, and depth, which takes for ever."""
    depth = 0
    for token in tokens:
        name = type(token).__name__
        depth += name.endswith("StartToken") - name.endswith("EndToken")
        if name == "AliasToken":
            raise ValueError("it has an alias (*)")
        if depth > _files.MAX_DEPTH:
            raise ValueError(f"its lists and mappings are nested deeper than {_files.MAX_DEPTH}")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return names and values as a dict; refuse a name that is there twice."""
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"it names {_checks.show(name)} twice")
        values[name] = value
    return values


_READERS: dict[str, Callable[[str], Any]] = {
    ".toml": _toml,
    ".yaml": _yaml,
    ".yml": _yaml,
    ".json": partial(json.loads, object_pairs_hook=_once),
}


def read_plan_file(path: Path) -> dict[str, Any]:
    """Return the values of a plan that a file gives, unchecked."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"a plan's file must end in {', '.join(_READERS)}; got {path}")
    try:
        text = _files.read_text(path)
        if len(text) > _MAX_TEXT:
            raise ValueError(f"it has more than {_MAX_TEXT} characters")
        given = reader(text)
        _files.check_depth(given)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}") from error
    except RecursionError as error:
        raise ValueError(f"{path} cannot be read: its lists are nested too deep") from error
    except ValueError as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    if not isinstance(given, dict):
        raise ValueError(
            f"{path} must hold names and values, such as n = [5, 10]; got {_checks.show(given)}"
        )
    return given  # pyright: ignore[reportUnknownVariableType]
