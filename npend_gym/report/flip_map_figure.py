"""The picture of a map of chaos: bright where a rod turns over at once, black where none does."""

# Matplotlib's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullLocator

from npend_gym._checks import FloatArray
from npend_gym.experiments import FlipMap
from npend_gym.report.style import styled

_EARLIEST = 0.05  # of the window: what turns over before has the brightest colour
_NEVER = (0.02, 0.02, 0.06)
_SIDE, _LEFT, _BOTTOM, _WIDTH, _HEIGHT = 5.0, 0.85, 0.6, 6.9, 5.95  # inches
_LEAST_DPI = 140.0


@styled
def flip_map_figure(plan: FlipMap, times: FloatArray) -> Figure:
    """Draw the map that `plan.run` returned, at least a pixel for each start, over its angles."""
    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=max(_LEAST_DPI, plan.size / _SIDE))
    figure.set_layout_engine("none")  # so that a start is a pixel

    def place(left: float, width: float) -> Any:
        box = (left / _WIDTH, _BOTTOM / _HEIGHT, width / _WIDTH, _SIDE / _HEIGHT)
        return figure.add_axes(box)

    axes, bar = place(_LEFT, _SIDE), place(_LEFT + _SIDE + 0.15, 0.18)
    colours = ListedColormap(mpl.colormaps["inferno"](np.linspace(0.97, 0.12, 256)))
    first, second = np.degrees(np.array(plan.centre)[:, None] + plan.width * np.array([-0.5, 0.5]))
    shown = axes.imshow(
        np.ma.masked_invalid(times), cmap=colours.with_extremes(bad=_NEVER),
        origin="lower", interpolation="nearest",
        norm=LogNorm(_EARLIEST * plan.duration, plan.duration, clip=True),
        extent=(*first, *second),
    )  # fmt: skip
    axes.set(xlabel="first angle [degrees]", ylabel="second angle [degrees]")
    axes.set_title(f"when a rod first turns over (black: not within {plan.duration:g} s)")
    axes.grid(visible=False)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(45) if plan.width > np.pi else MaxNLocator(8))
    scale = figure.colorbar(shown, cax=bar, extend="min", label="time [s]")
    scale.locator, scale.formatter = LogLocator(subs=(1, 2, 5)), FuncFormatter("{0:g}".format)
    scale.minorlocator = NullLocator()
    scale.update_ticks()
    return figure
