"""The figure of `npend measure`: period against amplitude, and the decay of the amplitude."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from npend_gym._palette import BLUE, ORANGE
from npend_gym.identification import Swings
from npend_gym.report.style import legend_below, panels, styled
from npend_gym.theory import pendulum_factor


@styled
def swings_figure(swings: Swings) -> Figure:
    """Draw the period against the amplitude with the elliptic integral, and the decay."""
    figure = Figure(figsize=(7.6, 3.6))
    left, right = panels(figure, 1, 2)
    degrees = np.degrees(swings.amplitudes)
    theory: Any = np.linspace(0.0, 1.05 * float(swings.amplitudes.max()), 200)
    left.plot(degrees, swings.periods, "o", color=ORANGE, markersize=3, label="measured")
    left.plot(np.degrees(theory), swings.small_period * pendulum_factor(theory), color=BLUE,
              label="fit: elliptic integral; exponential decay")  # fmt: skip
    left.set(xlabel="amplitude [degrees]", ylabel="period [s]")
    right.plot(swings.times, degrees, "o", color=ORANGE, markersize=3)
    if math.isfinite(swings.decay):
        at = np.linspace(float(swings.times.min()), float(swings.times.max()), 200)
        level = np.mean(np.log(degrees) + swings.decay * swings.times)
        right.plot(at, np.exp(level - swings.decay * at), color=BLUE)
    right.set(xlabel="time [s]", ylabel="amplitude [degrees]", ylim=(0.0, 1.1 * degrees.max()))
    legend_below(figure, left, 2)
    return figure
