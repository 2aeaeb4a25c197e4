"""How motions show themselves in notebooks: a player, plots, films.

`Trajectory` has these functions as methods: `plot`, `animate`, and `_repr_html_`.
"""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from npend_gym import _checks
from npend_gym._palette import BLACK, GREEN, ORANGE
from npend_gym.recording import record_motion
from npend_gym.report import player

if TYPE_CHECKING:
    from npend_gym.report.animation import Film

_MOST_MOTIONS = 8  # of many, in a player
_MOST_PLACES = 60_000  # in a player: 0.6 MB of a notebook's file
_MOST_BOBS = 200  # shown of a chain
_INTERVAL = 0.04  # s: instants so close that straight lines join them well
_MOST_LABELS = 10  # rods with an entry of their own in a legend


def as_html(motion: Any) -> str:
    """Return a frame with the motion, to be played, as HTML: what notebooks show.

    It is the player of `npend release --page`: nothing is fetched, and what the frame runs is shut
    off from the notebook. Of many motions it has the first eight.
    """
    many = motion.theta.ndim > 2
    each = [motion[k] for k in range(min(len(motion), _MOST_MOTIONS))] if many else [motion]
    if motion.times.size < 2:
        return f"<code>{html.escape(repr(motion))}</code>"
    places = _MOST_PLACES // len(each)
    releases = [_played(one, k, places) for k, one in enumerate(each)]
    title = f"Motion of {_pendulums(motion.chain.n)}"
    text = player.page(
        "player.html",
        {"releases": releases},
        ("player.js",),
        title=title,
        playback=player.playback("Motion", hidden=not many),
    )
    return (
        f'<iframe title="{title}" sandbox="allow-scripts" srcdoc="{html.escape(text)}" '
        'style="width: 100%; max-width: 40rem; aspect-ratio: 1; border: 0"></iframe>'
    )


def _pendulums(n: int) -> str:
    return f"{n} pendulum{'s' * (n > 1)}"


def _played(motion: Any, k: int, most_places: int) -> dict[str, Any]:
    """Return motion `k` for the player: at most this many places, at equal intervals."""
    recording = record_motion(motion)
    shown, on_cart = recording.motion, recording.motion.chain.base is not None
    n, end = shown.chain.n, float(shown.times[-1])
    bobs = np.linspace(n - 1, 0, min(n, _MOST_BOBS)).round().astype(int)[::-1]
    most = max(2, most_places // bobs.size)
    instants = min(most, max(2, math.ceil(end / _INTERVAL) + 1))
    times = np.linspace(0.0, end, instants)
    at = shown.positions()[:, bobs]
    size = player.extent(shown.chain, at)
    at = recording.on_rail(at)
    places = np.stack(
        [
            np.stack([np.interp(times, shown.times, at[:, bob, axis]) for axis in (0, 1)], axis=-1)
            for bob in range(bobs.size)
        ],
        axis=1,
    )
    cart = np.interp(times, shown.times, recording.cart()) / size if on_cart else None
    centres = player.centres(shown) if bobs.size == n else []
    return {
        "label": f"{k}: {_pendulums(n)}",
        "periods": [None] * int(bobs.size),
        **player.moving(places / size, float(times[1]), centres, cart),
    }


def plot(motion: Any) -> Any:
    """Plot angles, angular velocities and energy against time (extra "plot").

    Of many motions it shows the last rod of each, in a colour of its own.

    Returns
    -------
    ndarray of matplotlib.axes.Axes, shape (3,)
        In a figure of `matplotlib.pyplot`, which notebooks show and ``plt.show()`` opens.

    Raises
    ------
    ValueError
        If a motion has less than two instants.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> motion = simulate(Chain.uniform(2), 1.0, 0.0, np.linspace(0.0, 5.0, 101))
    >>> [axes.get_ylabel() for axes in motion.plot()]
    ['angle [rad]', 'angular velocity [rad/s]', 'energy [J]']
    """
    from npend_gym.report.style import context, legend_below, rod_colors

    if motion.theta.ndim > 2:
        from npend_gym.report import together

        return together.plot(motion)
    shown = record_motion(motion).motion
    import matplotlib.pyplot as plt

    with context():
        figure, axes = plt.subplots(3, 1, sharex=True, figsize=(6.4, 5.6))
        n = shown.chain.n
        for rod, color in enumerate(rod_colors(n)):
            for ax, values in zip(axes, (motion.theta, motion.omega), strict=False):
                ax.plot(motion.times, values[:, rod], color=color, label=f"rod {rod + 1}")
        energy, kinetic = motion.energy(), motion.kinetic_energy()
        axes[2].plot(motion.times, energy, color=BLACK, label="energy")
        axes[2].plot(motion.times, kinetic, color=ORANGE, label="kinetic")
        axes[2].plot(motion.times, energy - kinetic, "--", color=GREEN, label="potential")
        labels = ("angle [rad]", "angular velocity [rad/s]", "energy [J]")
        for ax, label in zip(axes, labels, strict=True):
            ax.set_ylabel(label)
        lowest = min(0.0, float((energy - kinetic).min()))  # negative with a counterweight
        axes[2].set(xlabel="time [s]", ylim=(lowest, None))
        legend_below(figure, axes[2], 3)
        if n <= _MOST_LABELS:
            handles, names = axes[0].get_legend_handles_labels()
            figure.legend(handles, names, loc="outside upper center", ncols=min(n, 5))
    return axes


def animate(
    motion: Any,
    path: str | Path | None = None,
    *,
    fps: float = 25.0,
    speed: float = 1.0,
    size: int = 360,
    diagrams: bool = False,
) -> Film:
    """Film the motion (extras "plot" and "render"); a notebook shows what is returned.

    Many motions hang from one pivot, each in a colour of its own.

    Parameters
    ----------
    path : str or Path, optional
        File to write, .gif or .mp4, whole or not at all.
    fps : float
        Pictures a second.
    speed : float
        Seconds of the motion in a second of the film.
    size : int
        Height in pixels, even.
    diagrams : bool
        Whether diagrams of velocities and energy stand beside the chain.

    Returns
    -------
    Film

    Raises
    ------
    ValueError
        If an argument breaks its rule, or a motion has less than two instants.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> motion = simulate(Chain.uniform(2), 1.0, 0.0, np.linspace(0.0, 2.0, 51))
    >>> len(motion.animate())
    51
    """
    from npend_gym.report import animation

    file = None if path is None else _checks.path("path", path)
    options: Any = {"fps": fps, "speed": speed, "size": size, "diagrams": diagrams}
    if motion.theta.ndim > 2:
        from npend_gym.report.together import FilmOfMany

        film = FilmOfMany([record_motion(motion[k]) for k in range(len(motion))], **options)
    else:
        film = animation.Film(record_motion(motion), **options)
    if file is not None:
        _checks.choice("the suffix of path", file.suffix, animation.SUFFIXES)
        animation.write(film, file)
    return film
