"""What the paper says: every equation, number and claim, read from `claims.ini`."""

import re
from collections.abc import Iterable, Mapping
from configparser import RawConfigParser
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, cast

import numpy as np

# {name} or {name:format}; other braces, as in sum_{k<=j}, stand for themselves
_NUMBER = re.compile(r"\{([a-z][\w.-]*)(?::([^{}]*))?\}")


@dataclass(frozen=True)
class Claim:
    """One equation, number or claim of the paper; its fields are explained in `claims.ini`."""

    key: str
    section: str
    place: str
    claim: str
    printed: str = "-"
    ours: str = "-"
    note: str = ""
    cause: str = ""
    like: str = ""


@cache
def claims() -> dict[str, Claim]:
    """Return all claims by their keys, in the order of the paper."""
    parser = RawConfigParser(delimiters=(":",), comment_prefixes=("#",), default_section="")
    parser.read_string(files("paper").joinpath("claims.ini").read_text("utf-8"))
    fields: dict[str, dict[str, str]] = {}
    section = ""
    for name in parser.sections():
        own = {field: text.replace("\n", " ") for field, text in parser[name].items()}
        if own:
            fields[name] = {**fields.get(own.get("like", ""), {}), **own, "section": section}
        else:  # a title without fields begins a section of the paper
            section = name
    return {key: Claim(key, **texts) for key, texts in fields.items()}


def printed(key: str) -> tuple[str, ...]:
    """Return the numbers that the paper prints, as `claims.ini` lists them for a claim."""
    return tuple(claims()[key].printed.split(", "))


def render(template: str, numbers: Mapping[str, Any]) -> str:
    """Return `template` with every {name:format} replaced by the number of that name.

    The members of a list, array or tuple are formatted one by one and joined by commas, those of a
    tuple in brackets. KeyError is raised if the template names a number that is not there.
    """
    return _NUMBER.sub(lambda found: _show(numbers[found[1]], found[2] or ""), template)


def _show(value: Any, form: str) -> str:
    if isinstance(value, np.ndarray | list | tuple):
        shown = ", ".join(_show(member, form) for member in cast("Iterable[Any]", value))
        return f"({shown})" if isinstance(value, tuple) else shown
    return format(value, form)
