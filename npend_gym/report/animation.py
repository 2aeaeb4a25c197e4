"""Films of recorded motions (extras "plot" and "render"): the chain beside its diagrams."""

from __future__ import annotations

import base64
import errno
import html
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from subprocess import PIPE, Popen
from typing import IO, Any, TypeVar, cast

import numpy as np

from npend_gym import _checks, _extras, _files
from npend_gym._palette import BLACK, BLUE, GREEN, INK, ORANGE, PAPER, rgb
from npend_gym.recording import Recording, check_angles
from npend_gym.render import Frame, Painter, Scene, pygame_module

try:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
except (ImportError, ValueError) as _error:  # ValueError: of a wrong MPLBACKEND
    raise _extras.missing("matplotlib", "plot,render", "films", _error) from _error
from npend_gym.report.style import legend_below, styled

SUFFIXES = (".gif", ".mp4")
INCHES = 4.8  # height of the diagrams: sets the size of their text
_TRACE_SECONDS = 3.0
_COLORS, _GIF_FPS = 128, 50  # of a GIF, at most: browsers slow down shorter delays
_GIF_SECONDS = 655  # of a picture in a GIF, at most: delays have 16 bits
_SIGNS = LinearSegmentedColormap.from_list("signs", [BLUE, "#F7F7F7", ORANGE])
_TITLES = {
    "bob": "bobs going left (blue), right (orange); dot: turned twice",
    "link": "rods turning clockwise (blue) or not; dot: turned twice",
    "com": "centre of mass going left (blue), right; dot: turned twice",
    "height": "bobs below (blue) or above their start; dot: back",
}
_TITLES["horizontal"] = _TITLES["bob"]
_AROUND = {
    "bob": "bobs going clockwise (blue) or not; dot: turned twice",
    "com": "centre of mass going clockwise (blue) or not; dot: turned twice",
}

_T = TypeVar("_T")
Progress = Callable[[Iterable[_T]], Iterable[_T]]


class Film:
    """The pictures of a recording, painted one by one as they are asked for.

    Parameters
    ----------
    recording : Recording
    fps : float
        Pictures a second.
    speed : float
        Seconds of the motion in a second of the film.
    size : int
        Height in pixels, an even number; the width is twice that, or the same without diagrams.
    diagrams : bool
        Whether the diagrams stand beside the chain.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        fps: float = 25.0,
        speed: float = 1.0,
        size: int = 480,
        diagrams: bool = True,
    ) -> None:
        self.recording = recording
        self.fps: float = _checks.positive_number("fps", fps)
        self.speed: float = _checks.positive_number("speed", speed)
        check_size(size)
        self._painter = Painter(size)
        motion = recording.motion
        interval = self.speed / self.fps
        check_angles(float(motion.times[-1]) / interval, motion.chain.n, "lower fps or raise speed")
        times = interval * np.arange(int(motion.times[-1] / interval + 1e-6) + 1)
        self._shown = np.searchsorted(motion.times, times + 1e-6 * interval, side="right") - 1
        self._places, self._energy = recording.positions(), motion.energy()
        self._cart = recording.cart()
        self.rail: float = recording.rail or float(np.abs(self._cart).max())
        farthest = float(np.abs(self._places).max())  # on springs, or beside the end of a rail
        self.reach: float = max(self.rail, motion.chain.total_length, farthest)
        self._centres = recording.on_rail(motion.bodies())
        self._turned = recording.turning_points()
        self._diagrams = self._drawn() if diagrams else None

    def __len__(self) -> int:
        return self._shown.size

    def __iter__(self) -> Iterator[Frame]:
        return map(self.picture, range(len(self)))

    def _repr_html_(self) -> str:
        """Return the film as a GIF within HTML: what a notebook shows.

        Of more than 50 pictures a second it shows every second, third and so on.
        """
        file, step = io.BytesIO(), math.ceil(self.fps / _GIF_FPS)
        shown = self if step == 1 else self._again(
            fps=self.fps / step, speed=self.speed, size=self._painter.size,
            diagrams=self._diagrams is not None,
        )  # fmt: skip
        _check_gif(shown.fps)
        _write_gif(shown, file, "", iter)
        data = base64.b64encode(file.getvalue()).decode()
        return (
            f'<img alt="{html.escape(self.recording.caption)}" src="data:image/gif;base64,{data}">'
        )

    def _again(self, **options: Any) -> Film:
        """Return the film with other options."""
        return Film(self.recording, **options)

    def _drawn(self) -> tuple[Frame, Frame, tuple[int, int, int, int]]:
        return pictures_of(_draw(self.recording), self._painter.size)

    def picture(self, k: int) -> Frame:
        """Return picture `k`, of shape (size, 2 size, 3), or (size, size, 3) without diagrams."""
        chain = self._painter.paint(self.scene(k))
        if self._diagrams is None:
            return chain
        return np.hstack([chain, self._diagrams_at(k, *self._diagrams)])

    def scene(self, k: int) -> Scene:
        """Contents of picture `k` of the chain; after the last, how it ended."""
        recording, now = self.recording, self._shown[k] if k < len(self) else -1
        motion, time = recording.motion, recording.motion.times[now]
        done = recording.periods <= time
        first = max(0, k - round(_TRACE_SECONDS * self.fps / self.speed))
        on_cart = recording.joint == motion.chain.n
        acts = float(np.clip(recording.torque[now], -1.0, 1.0))  # noise may take it beyond
        return Scene(
            positions=self._places[now],
            reach=self.reach,
            time=float(time),
            energy=float(self._energy[now]),
            pseudo_period=self._mean(done),
            completed=int(done.sum()),
            torque=0.0 if on_cart else acts,
            caption=recording.caption,
            trace=self._places[self._shown[first:k], -1],
            marks=self._turned[done],
            centres=self._centres[now],
            joint=0 if on_cart else recording.joint,
            rail=self.rail,
            cart=float(self._cart[now]),
            force=acts if on_cart else 0.0,
        )

    def _mean(self, done: Any) -> float | None:
        """Return the mean pseudo-period [s] of bobs, 0 for none; None where none is asked for."""
        if not self.recording.timed:
            return None
        return float(self.recording.periods[done].mean()) if done.any() else 0.0

    def _diagrams_at(
        self, k: int, before: Frame, after: Frame, box: tuple[int, int, int, int]
    ) -> Frame:
        """Return the diagrams as far as they are known at picture `k`."""
        times, (left, top, right, bottom) = self.recording.motion.times, box
        now = round(left + (right - left) * times[self._shown[k]] / times[-1])
        picture = before.copy()
        picture[:, :now] = after[:, :now]
        picture[top:bottom, now - 1 : now + 1] = rgb(INK)
        return picture


@styled
def _draw(recording: Recording) -> Figure:
    motion = recording.motion
    figure = Figure(figsize=(INCHES, INCHES), facecolor=PAPER)
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, 0.01, 0.97, 0.98))  # left, bottom, width, height
    axes: Any = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    signals = recording.signals().T
    signals = signals / np.maximum(np.abs(signals).max(axis=1, keepdims=True), 1e-300)
    n, times = motion.chain.n, motion.times
    edges = np.append(times, 2 * times[-1] - times[-2])
    bobs = np.arange(1, n + 1)
    axes[0].pcolormesh(
        edges, np.arange(n + 1) + 0.5, signals, cmap=_SIGNS, vmin=-1, vmax=1, zorder=2
    )
    axes[0].plot(
        recording.periods, bobs, "o", color=BLACK, markersize=min(4.0, max(1.5, 60.0 / n)), zorder=3
    )
    axes[0].set(ylim=(n + 0.5, 0.5), ylabel="bob, from the pivot")
    titles = _AROUND if recording.is_around else _TITLES
    title = titles[recording.definition]
    axes[0].set_title(title if recording.timed else title.partition(";")[0], fontsize=9)
    axes[0].yaxis.get_major_locator().set_params(integer=True, min_n_ticks=1)
    kinetic = motion.kinetic_energy()
    lowest = min(0.0, float((motion.energy() - kinetic).min()))  # negative with a counterweight
    for values, color, label in (
        (motion.energy(), BLACK, "energy"), (kinetic, ORANGE, "kinetic"),
        (motion.energy() - kinetic, GREEN, "potential"),
    ):  # fmt: skip
        axes[1].plot(times, values, color=color, label=label)
    axes[1].set(xlim=(0.0, times[-1]), ylim=(lowest, None), xlabel="time [s]", ylabel="energy [J]")
    legend_below(figure, axes[1], 3)
    return figure


def pictures_of(figure: Any, size: int) -> tuple[Frame, Frame, tuple[int, int, int, int]]:
    """Return diagrams before and after the motion, and the pixels that time runs through.

    The latter are those from the left, top, right and bottom of all axes.
    """
    figure.set_dpi(size / INCHES)
    canvas = FigureCanvasAgg(figure)

    def picture() -> Frame:
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    after = picture()
    figure.set_layout_engine("none")  # stays as it is when the data are hidden
    for axes in figure.axes:
        for artist in (*axes.lines, *axes.collections):
            artist.set_visible(False)
    upper, lower = (axes.get_window_extent() for axes in figure.axes)
    left, top = round(upper.x0), round(size - upper.y1)
    return picture(), after, (left, top, round(upper.x1), round(size - lower.y0))


def check_size(size: int) -> None:
    """Refuse the height of a film that is too small, too large or odd."""
    if _checks.picture_size("size", size, low=120) % 2:
        raise ValueError(f"size must be even, because videos have even sizes, got {size}")


def check_suffix(path: Path, fps: float) -> str:
    """Return the suffix of a film, if such a file can be made at `fps` pictures a second."""
    suffix = _checks.choice("the suffix of the film", path.suffix, SUFFIXES)
    pygame_module()
    if suffix == ".gif":
        _check_gif(fps)
    else:
        _ffmpeg()
    return suffix


def _ffmpeg() -> str:
    """Return the path of the program ffmpeg."""
    return _extras.require("imageio_ffmpeg", "render", "MP4 films").get_ffmpeg_exe()


def _check_gif(fps: float) -> None:
    if fps > _GIF_FPS:
        raise ValueError(
            f"fps must be at most {_GIF_FPS} in a GIF, which shows each picture for whole "
            f"hundredths of a second, got {fps:g}: write an .mp4, or lower fps"
        )
    if fps * _GIF_SECONDS < 1.0:
        raise ValueError(
            f"fps must be at least {1.0 / _GIF_SECONDS:.5f} in a GIF, which shows each picture for "
            f"at most {_GIF_SECONDS} s, got {fps:g}: write an .mp4, or raise fps"
        )


def write(film: Film, path: Path, progress: Progress[Frame] = iter) -> Path:
    """Write `film` to `path`, .gif or .mp4, whole or not at all; provenance is in its comment.

    `progress` may wrap the iteration over the pictures, for a progress bar.
    """
    write_as = _write_gif if check_suffix(path, film.fps) == ".gif" else _write_mp4
    about = film.recording.provenance | {"fps": film.fps, "speed": film.speed}
    with _files.replacing(path, binary=True) as file:
        write_as(film, file, json.dumps(about), progress)
    return path


def _write_gif(film: Film, file: Any, comment: str, progress: Progress[Frame]) -> None:
    from PIL import Image

    ends = np.round(100.0 * np.arange(len(film) + 1) / film.fps).astype(int)
    # one palette for all pictures, so that what stands still costs nothing
    some = [film.picture(k) for k in np.linspace(0, len(film) - 1, 4).astype(int).tolist()]
    palette = Image.fromarray(np.vstack(some)).quantize(
        _COLORS, method=Image.Quantize.MAXCOVERAGE, kmeans=3
    )

    def reduced(frame: Frame) -> Any:
        return Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)

    first, *rest = map(reduced, progress(film))
    try:
        first.save(
            file, "GIF", save_all=True, append_images=rest, loop=0, optimize=True,
            duration=(10 * np.diff(ends)).tolist(), comment=comment.encode(),
        )  # fmt: skip
    except OverflowError as error:  # of pictures that are alike there is one, shown for longer
        raise ValueError(
            f"nothing may stand still for more than {_GIF_SECONDS} s in a GIF: write an .mp4, or "
            "raise speed"
        ) from error


def _write_mp4(film: Film, file: Any, comment: str, progress: Progress[Frame]) -> None:
    height, width, _ = film.picture(0).shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(film.fps)]
    options = ["-f", "mp4", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-threads", "1"]
    about = ["-fflags", "+bitexact", "-metadata", f"comment={comment}"]
    command = [_ffmpeg(), "-y", "-v", "error", *raw, "-i", "-", *options]
    with Popen(  # noqa: S603 - imageio's ffmpeg
        [*command, *about, f"file:{file.name}"], stdin=PIPE, stderr=PIPE
    ) as ffmpeg:
        pipe = cast("IO[bytes]", ffmpeg.stdin)
        try:
            with suppress(BrokenPipeError):  # it has ended, and tells why
                for frame in progress(film):
                    pipe.write(frame.tobytes())
            told = ffmpeg.communicate()[1].decode(errors="replace").splitlines()
        finally:  # after Ctrl-C `Popen` waits for a quarter of a second, and leaves it running
            ffmpeg.kill()
            with suppress(BrokenPipeError):
                pipe.close()
            ffmpeg.wait()
    if ffmpeg.returncode != 0:
        raise OSError(errno.EIO, " ".join(told[:2]) or "ffmpeg failed")
