"""What is written on the command line as values: numbers, lists, angles, chains, settings."""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

_T = TypeVar("_T")

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_DEGREES = re.compile(rf"([+-]?{_NUMBER}) ?(?:deg|degrees)")
_PI = re.compile(rf"([+-]?)(?:({_NUMBER}) ?\*? ?)?pi(?:/({_NUMBER}))?")


def _items(kind: Callable[[str], _T], text: str, rule: str) -> list[_T]:
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be {rule}; got {text}") from error


def numbers(text: str) -> float | list[float]:
    """Return one number, or the numbers of a list joined by commas."""
    values = _items(float, text, "a number, or numbers joined by commas such as 1,0.5,2")
    return values if len(values) > 1 else values[0]


def numbers_per_rod(text: str) -> list[float | list[float]]:
    """Return a list joined by commas: of numbers, or of those of each rod joined by colons."""

    def per_rod(part: str) -> float | list[float]:
        rods = [float(rod) for rod in part.split(":")]
        return rods if len(rods) > 1 else rods[0]

    return _items(per_rod, text, "numbers joined by commas, or by colons for each rod, as 1,1:2:3")


def integers(text: str) -> list[int]:
    """Return the integers of a list joined by commas."""
    return _items(int, text, "whole numbers joined by commas such as 1,2,3")


def path(text: str) -> Path:
    """Return a path; refuse an empty text, which `Path` takes for the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("must be a path, got ''; is a shell variable unset?")
    return Path(text)


def folder(text: str) -> Path | str:
    """Return a path, or the URL of a folder in an object store as it is."""
    return text if "://" in text else path(text)


def texts(text: str) -> list[str]:
    """Return the texts of a list joined by commas."""
    return text.split(",")


def angle(text: str) -> float:
    """Return an angle [rad] that is written as 0.5, pi/3 or 60deg."""
    if degrees := _DEGREES.fullmatch(text):
        return math.radians(float(degrees[1]))
    if multiple := _PI.fullmatch(text):
        sign, factor, divisor = multiple.groups()
        if float(divisor or 1.0) > 0.0:
            return float(f"{sign}1") * float(factor or 1.0) * math.pi / float(divisor or 1.0)
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"must be an angle in radians such as 0.5 or pi/3, or in degrees such as 60deg; "
            f"got {text}"
        ) from error


def angles(text: str) -> list[float]:
    """Return the angles [rad] of a list joined by commas."""
    return [angle(part) for part in text.split(",")]


def columns(text: str) -> dict[str, str]:
    """Columns by name, "time=t,theta0=q1"; a name with a comma stands in quotation marks."""
    parts = re.findall(r'(?:"[^"]*"|[^,"])+|(?<=,)(?=,|$)|^$', text)
    pairs = [part.replace('"', "").partition("=") for part in parts]
    if text.count('"') % 2 or not all(name and sign and column for name, sign, column in pairs):
        raise argparse.ArgumentTypeError(
            f'must be like time=t,theta0=q1, names with a comma like theta0="q, left", got {text!r}'
        )
    found = {name.strip(): column.strip() for name, _, column in pairs}
    if len(found) < len(pairs):
        raise argparse.ArgumentTypeError(f"must name each column of ours once, got {text!r}")
    return found


def chain_argument(text: str) -> Any:
    """Return a preset's name as it is, or the parameters in a JSON file of that name."""
    from npend_gym.chain import PRESETS
    from npend_gym.chain.choice import chain_parameters

    try:
        return text if text in PRESETS else chain_parameters(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def setting(text: str) -> tuple[str, Any]:
    """Return name and value of NAME=VALUE: a value of JSON, or else a text.

    A text for the chain is that of `chain_argument`, a preset's name or a file.
    """
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text}")
    try:
        given = json.loads(value)
    except ValueError:
        given = float(value) if re.fullmatch(f"[+-]?{_NUMBER}", value) else value  # as .5
    except RecursionError as error:
        raise argparse.ArgumentTypeError(f"{name} has too many lists inside each other") from error
    return name, chain_argument(given) if name == "chain" and isinstance(given, str) else given
