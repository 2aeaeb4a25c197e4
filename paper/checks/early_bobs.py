"""What the paper says of its definition at large angles: bobs near the pivot complete early."""

import math
from typing import Any, NamedTuple

import numpy as np

from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import AMBER, BLACK, BLUE, GREEN, ORANGE
from paper import hesitation
from paper.hesitation import EARLY, Velocities
from paper.registry import Figure, Outcome, check, figure, holds_if, table

COUNTS = (50, 100, 200, 400)
ANGLES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, PAPER_AMPLITUDE, 0.9, 1.0, 1.1, 1.2)
SHOWN = (0.5, PAPER_AMPLITUDE, 1.0)  # rad, a panel each
BOBS = (0.95, 0.9, 0.8, 0.7)  # heights of the bobs that are drawn


@check("hesitation")
def _early_bobs(n_values: tuple[int, ...] = COUNTS) -> Outcome:
    small, paper = (hesitation.hesitation_rows(n_values, (a,)) for a in (0.3, PAPER_AMPLITUDE))
    tip, back = hesitation.front_times(n_values[-1], PAPER_AMPLITUDE)
    onset = [hesitation.onset(n) for n in n_values[-3:]]
    shares = [row["share"] for row in paper]
    return holds_if(
        shares[-1] > 5.0 * small[-1]["share"], counts=list(n_values), shares=shares,
        small=[row["share"] for row in small], means=[row["mean"] for row in paper], onset=onset,
        earliest=paper[-1]["earliest"], tip=tip, back=back,
    )  # fmt: skip


@table("hesitation", "hesitation")
def rows(n_values: tuple[int, ...] = COUNTS) -> list[dict[str, Any]]:
    """Return the tidy table of early bobs over N and angle."""
    return hesitation.hesitation_rows(n_values, ANGLES)


class Hesitation(NamedTuple):
    """Velocities of some bobs at three angles, and the table of early bobs."""

    velocities: list[Velocities]
    rows: list[dict[str, Any]]


@figure(
    "hesitation", "hesitation",
    "Above: horizontal velocity of bobs near the pivot, 400 rods, by the greatest speed they have "
    "had; the grey band marks the front's way back from the lowest of them to the pivot, the dots "
    "where a pseudo-period is complete. Below: the share of bobs that complete early, and the mean "
    "over the bobs.",
    size=(7.2, 5.2),
    data=lambda: Hesitation([hesitation.velocities(COUNTS[-1], a, BOBS) for a in SHOWN], rows()),
)  # fmt: skip
def _draw_hesitation(figure: Figure, data: Hesitation) -> None:
    halves: Any = figure.subfigures(2, 1, height_ratios=(1.1, 1.0))
    above, below = halves
    for axes, angle, shown in zip(above.subplots(1, 3), SHOWN, data.velocities,
                                  strict=True):  # fmt: skip
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.axvspan(shown.passes.min(), shown.front, color="0.6", alpha=0.4, linewidth=0.0)
        for height, values, color in zip(shown.heights, shown.values, (BLUE, GREEN, AMBER, ORANGE),
                                         strict=True):  # fmt: skip
            axes.plot(shown.times, values, color=color, linewidth=1.0, label=f"s = {height:.2f}")
            done = _completed(shown.times, values)
            axes.plot(done, np.zeros_like(done), "o", color=color, markersize=4)
        axes.set(ylabel="velocity / greatest so far")
        axes.set(
            title=f"{angle:.3g} rad", xlabel="time / $T_1$", xlim=(0.3, 1.15), ylim=(-0.3, 0.3)
        )
    above.axes[2].legend(fontsize=7, loc="center", bbox_to_anchor=(0.6, 0.75), handlelength=1.0)
    share, mean = below.subplots(1, 2)
    for n, color in zip(dict.fromkeys(row["n"] for row in data.rows), (ORANGE, AMBER, GREEN, BLUE),
                        strict=False):  # fmt: skip
        some = [row for row in data.rows if row["n"] == n]
        angles = [row["angle_rad"] for row in some]
        share.plot(angles, [row["share"] for row in some], "o-", color=color, markersize=3,
                   label=f"N = {n}")  # fmt: skip
        mean.plot(angles, [row["mean"] for row in some], "o-", color=color, markersize=3)
    share.set(xlabel="starting angle [rad]", ylabel=f"share of bobs before {EARLY} $T_1$")
    mean.set(xlabel="starting angle [rad]", ylabel="mean over the bobs / $T_1$")
    share.legend(fontsize=7)


def _completed(times: Any, values: Any) -> Any:
    """Return the first crossing from + to - after one from - to +, if there is one, as an array."""
    sign = np.sign(values)
    rising = np.flatnonzero((sign[:-1] < 0) & (sign[1:] > 0))
    falling = np.flatnonzero((sign[:-1] > 0) & (sign[1:] < 0))
    later = falling[falling > rising[0]] if rising.size else rising
    return times[later[:1]] if later.size else np.full(1, math.nan)
