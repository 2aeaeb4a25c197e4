"""Checks, figures and tables of the audit, registered where they are defined.

    @check("torque")
    def _torque() -> Outcome:
        off = torque_error()
        return holds_if(off < 1e-8, off=off)

computes what the claim "torque" of `claims.ini` needs, and nothing else: the verdict, and the
numbers that the claim's text names. What several checks need is computed by cached functions.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from enum import Enum
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, NamedTuple, TypeVar

_T = TypeVar("_T")
_F = TypeVar("_F", bound=Callable[..., Any])


class Verdict(Enum):
    """Whether what the paper says is true."""

    HOLDS = "holds"
    CORRECTED = "holds with a correction"
    FAILS = "does not hold"
    UNDECIDABLE = "not decidable"


class Outcome(NamedTuple):
    """What a check found: the verdict, and the numbers that the claim's text shows, by name."""

    verdict: Verdict
    numbers: dict[str, Any]


def holds_if(condition: bool, otherwise: Verdict = Verdict.FAILS, /, **numbers: Any) -> Outcome:
    """Return the outcome "holds" if the `condition` is true, else `otherwise`."""
    return Outcome(Verdict.HOLDS if condition else otherwise, numbers)


def corrected_if(condition: bool, /, **numbers: Any) -> Outcome:
    """Return "holds with a correction" if the `condition` is true, else "does not hold"."""
    return Outcome(Verdict.CORRECTED if condition else Verdict.FAILS, numbers)


class Drawing(NamedTuple):
    """A figure: the claim it belongs to, its size [inches], its data and how they are drawn."""

    claim: str
    size: tuple[float, float]
    data: Callable[..., Any]
    fill: Callable[[Any, Any], None]

    def draw(self, data: Any) -> Any:
        """Return `data` as a figure of matplotlib, in the package's style."""
        from npend_gym.report.style import Figure, styled

        @styled
        def filled() -> Figure:
            figure = Figure(figsize=self.size)
            self.fill(figure, data)
            return figure

        return filled()


class Table(NamedTuple):
    """A tidy table: the claim it belongs to, and the function that returns its rows."""

    claim: str
    rows: Callable[..., list[dict[str, Any]]]


_checks: dict[str, Callable[..., Outcome]] = {}
_drawings: dict[str, Drawing] = {}
_tables: dict[str, Table] = {}


def check(*keys: str) -> Callable[[_F], _F]:
    """Register a function as the check of a claim; of several like claims, it has a `key`."""

    def register(compute: _F) -> _F:
        _checks.update(dict.fromkeys(keys, compute))
        return compute

    return register


def table(name: str, claim: str) -> Callable[[_F], _F]:
    """Register a function that returns the rows of `name`.csv, which is written with a claim."""

    def register(rows: _F) -> _F:
        _tables[name] = Table(claim, rows)
        return rows

    return register


def figure(
    name: str, claim: str, size: tuple[float, float], data: Callable[..., Any]
) -> Callable[[_F], _F]:
    """Register a function that draws `data()` into an empty figure, written with a claim."""

    def register(fill: _F) -> _F:
        _drawings[name] = Drawing(claim, size, data, fill)
        return fill

    return register


@cache
def _load() -> None:
    package = import_module("npend_gym.paper.checks")
    for module in iter_modules(package.__path__, package.__name__ + "."):
        import_module(module.name)


def checks() -> dict[str, Callable[..., Outcome]]:
    """Return every check by the key of its claim."""
    _load()
    return _checks


def drawings() -> dict[str, Drawing]:
    """Return every figure by its name."""
    _load()
    return _drawings


def tables() -> dict[str, Table]:
    """Return every table by its name."""
    _load()
    return _tables


def call(function: Callable[..., _T], **options: Any) -> _T:
    """Call `function` with those of the `options` that it has arguments for."""
    wanted = inspect.signature(function).parameters
    return function(**{name: value for name, value in options.items() if name in wanted})
