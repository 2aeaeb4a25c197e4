"""What all figures share (extra "plot"): the style, markers, panels, legends, shades of blue."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from importlib.resources import as_file, files
from typing import Any, ParamSpec

from npend_gym import _extras
from npend_gym._palette import (
    AMBER,
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PINK,
    RAMP,
    SKY,
    mixed,
)

try:
    import matplotlib.style
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter
except (ImportError, ValueError) as _error:  # ValueError: of a wrong MPLBACKEND
    raise _extras.missing("matplotlib", "plot", "figures", _error) from _error

TRIALS = (("o", SKY), ("s", BLUE), ("^", BLACK))
_RODS = BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK

_P = ParamSpec("_P")


@contextmanager
def context() -> Generator[None, None, None]:
    """Draw in the package's style, whatever the user's own, inside a `with` statement."""
    with (
        as_file(files("npend_gym.report") / "npend.mplstyle") as style,
        matplotlib.style.context(["default", str(style)]),
    ):
        yield


def styled(draw: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Draw in the package's style, whatever the user's own."""
    return context()(draw)


def panels(
    figure: Figure, rows: int, columns: int, *, sharex: bool = False,
    height_ratios: Sequence[float] | None = None,
) -> list[Any]:  # fmt: skip
    """Return the axes of a grid of panels, row by row."""
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False, height_ratios=height_ratios)
    return list(axes.flat)


def shade(share: float) -> tuple[float, float, float]:
    """Return a blue, the darker the larger `share` (0 to 1)."""
    return 0.65 * (1.0 - share), 0.25 + 0.55 * (1.0 - share), 0.45 + 0.5 * (1.0 - share)


def rod_colors(n: int) -> list[Any]:
    """Return a colour for each of n rods: the distinct ones, or shades from pivot to tip."""
    if n <= len(_RODS):
        return [*_RODS[:n]]
    return [tuple(c / 255.0 for c in mixed(RAMP, rod / (n - 1))) for rod in range(n)]


def legend_below(figure: Figure, axes: Any, columns: int) -> None:
    """Put the legend of `axes` below all that the figure has."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(columns, len(labels)))


def mark_numbers(axis: Any, numbers: Sequence[float]) -> None:
    """Mark `numbers` alone on an axis, as they are written in a text."""
    axis.set(major_locator=FixedLocator(list(numbers)), minor_locator=NullLocator())
    axis.set_major_formatter(ScalarFormatter())
