"""Several motions in one plot and one film, each in a colour (extras "plot" and "render")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from npend_gym._palette import PAPER, distinct
from npend_gym.recording import Recording, check_angles
from npend_gym.render import Frame, Scene
from npend_gym.report.animation import INCHES, Figure, Film, pictures_of
from npend_gym.report.style import context, styled

_MOST_LABELS = 12  # motions with an entry of their own in a legend
_TRACE = 0.4  # of that of a motion alone


def plot(motions: Any) -> Any:
    """Plot each motion's last rod and its energy; see `Trajectory.plot`."""
    import matplotlib.pyplot as plt

    with context():
        figure, axes = plt.subplots(3, 1, sharex=True, figsize=(6.4, 5.6))
        _draw_lines(figure, axes, [motions[k] for k in range(len(motions))])
    return axes


def _draw_lines(figure: Any, axes: Sequence[Any], motions: Sequence[Any]) -> None:
    """Draw angle, angular velocity where there are three axes, and energy against time."""
    labels = ["angle [rad]", "angular velocity [rad/s]", "energy [J]"]
    if len(axes) < len(labels):
        del labels[1]
    for k, (motion, color) in enumerate(zip(motions, distinct(len(motions)), strict=True)):
        rows = [motion.theta[:, -1], motion.omega[:, -1], motion.energy()]
        for ax, values in zip(axes, rows if len(axes) == len(rows) else rows[::2], strict=True):
            ax.plot(motion.times, values, color=color, label=f"motion {k}", alpha=0.85)
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label)
    if motions[0].chain.n > 1:
        axes[0].set_title("last rod", fontsize=9)
    lowest = min(0.0, axes[-1].dataLim.ymin)  # negative with a counterweight
    axes[-1].set(xlabel="time [s]", ylim=(lowest, None))
    if len(motions) <= _MOST_LABELS:
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper center", ncols=min(len(motions), 4))


@styled
def _drawn(recordings: Sequence[Recording]) -> Figure:
    figure = Figure(figsize=(INCHES, INCHES), facecolor=PAPER)
    axes: Any = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    motions = [recording.motion for recording in recordings]
    _draw_lines(figure, axes, motions)
    axes[1].set_xlim(0.0, max(motion.times[-1] for motion in motions))
    return figure


class FilmOfMany(Film):
    """The pictures of motions that start together; see `Film`.

    Parameters
    ----------
    recordings : sequence of Recording
        One for each motion; what ends earlier stays where it ended.
    """

    def __init__(self, recordings: Sequence[Recording], **options: Any) -> None:
        self._recordings = recordings
        self._colors = distinct(len(recordings))
        super().__init__(max(recordings, key=lambda each: each.motion.times[-1]), **options)
        check_angles(
            len(self) * len(recordings), recordings[0].motion.chain.n, "lower fps or raise speed"
        )
        self._films = [Film(each, **options | {"diagrams": False}) for each in recordings]
        self.rail = max(film.rail for film in self._films)
        self.reach = max(film.reach for film in self._films)

    def _again(self, **options: Any) -> Film:
        return FilmOfMany(self._recordings, **options)

    def _drawn(self) -> tuple[Frame, Frame, tuple[int, int, int, int]]:
        return pictures_of(_drawn(self._recordings), self._painter.size)

    def scene(self, k: int) -> Scene:
        """Contents of picture `k` of the chains, the first one in front."""
        now, scenes = super().scene(k), list[Scene]()
        for film, color in zip(self._films, self._colors, strict=True):
            own = film.scene(k)
            trace = own.trace[len(own.trace) - round(_TRACE * len(own.trace)) :]
            scenes.append(replace(own, reach=self.reach, rail=self.rail, trace=trace, color=color))
        caption = f"{len(scenes)} motions, {now.caption}"
        return replace(scenes[0], time=now.time, caption=caption, beside=tuple(scenes[:0:-1]))
