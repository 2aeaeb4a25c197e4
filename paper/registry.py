"""Checks, figures and tables of the audit, registered where they are defined.

    @check("torque")
    def _torque() -> Outcome:
        off = torque_error()
        return holds_if(off < 1e-8, off=off)

computes what the claim "torque" of `claims.ini` needs, and nothing else: the verdict, and the
numbers that the claim's text names. What several checks need is computed by cached functions.
"""

import inspect
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # an extra
else:
    Figure: TypeAlias = Any

_T = TypeVar("_T")
_F = TypeVar("_F", bound=Callable[..., Any])


class Verdict(Enum):
    """Whether what the paper says is true."""

    HOLDS = "holds"
    SLIP = "holds but for a slip"  # of the pen: what is meant is clear, and right
    FAILS = "does not hold"
    UNDECIDABLE = "not decidable"


class Outcome(NamedTuple):
    """What a check found: the verdict, and the numbers that the claim's text shows, by name."""

    verdict: Verdict
    numbers: dict[str, Any]


def holds_if(condition: bool, otherwise: Verdict = Verdict.FAILS, /, **numbers: Any) -> Outcome:
    """Return the outcome "holds" if the `condition` is true, else `otherwise`."""
    return Outcome(Verdict.HOLDS if condition else otherwise, numbers)


def slip_if(condition: bool, /, **numbers: Any) -> Outcome:
    """Return "holds but for a slip" if the `condition` is true, else "does not hold"."""
    return Outcome(Verdict.SLIP if condition else Verdict.FAILS, numbers)


class Drawing(NamedTuple):
    """A figure: the claim it belongs to, caption, size [inches], data and how they are drawn."""

    claim: str
    caption: str
    size: tuple[float, float]
    data: Callable[..., Any]
    fill: Callable[[Figure, Any], None]

    def draw(self, data: Any) -> Figure:
        """Return `data` as a figure in the package's style."""
        from matplotlib.figure import Figure

        from npend_gym.report import context

        with context():
            figure = Figure(figsize=self.size)
            self.fill(figure, data)
        return figure


class Table(NamedTuple):
    """A tidy table: the claim it belongs to, and the function that returns its rows."""

    claim: str
    rows: Callable[..., list[dict[str, Any]]]


# Checks by the keys of their claims, figures and tables by name; paper.checks fills them
CHECKS: dict[str, Callable[..., Outcome]] = {}
DRAWINGS: dict[str, Drawing] = {}
TABLES: dict[str, Table] = {}


def check(*keys: str) -> Callable[[_F], _F]:
    """Register a function as the check of a claim; of several like claims, it has a `key`."""

    def register(compute: _F) -> _F:
        CHECKS.update(dict.fromkeys(keys, compute))
        return compute

    return register


def table(name: str, claim: str) -> Callable[[_F], _F]:
    """Register a function that returns the rows of `name`.csv, which is written with a claim."""

    def register(rows: _F) -> _F:
        TABLES[name] = Table(claim, rows)
        return rows

    return register


def figure(
    name: str, claim: str, caption: str, size: tuple[float, float], data: Callable[..., Any]
) -> Callable[[_F], _F]:
    """Register a function that draws `data()` into an empty figure, written with a claim."""

    def register(fill: _F) -> _F:
        DRAWINGS[name] = Drawing(claim, caption, size, data, fill)
        return fill

    return register


def call(function: Callable[..., _T], **options: Any) -> _T:
    """Call `function` with those of the `options` that it has arguments for."""
    wanted = inspect.signature(function).parameters
    return function(**{name: value for name, value in options.items() if name in wanted})
