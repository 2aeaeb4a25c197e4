"""Pictures of a chain by pygame-ce (extra "render"), in memory; no display is opened."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _extras
from npend_gym._checks import FloatArray
from npend_gym._palette import AMBER, BLUE, GREEN, INK, ORANGE, PAPER, PINK, RIM, ROD, WHITE, rgb

Frame = NDArray[np.uint8]

_SAMPLES = 4  # drawn this many times larger and averaged down; only powers of two keep a color
_RADIUS = 440.0  # of the reach, in thousandths of the picture; the rest is a strip for the text
_BOBS, _TRACE = 2000, 600  # drawn at most: more than anyone can tell apart

_RAMP = tuple(map(rgb, (BLUE, GREEN, AMBER)))  # gains in lightness from pivot to tip
_TIP, _TORQUE, _PAPER, _DISC = map(rgb, (ORANGE, PINK, PAPER, WHITE))
_RIM, _ROD, _INK = map(rgb, (RIM, ROD, INK))


def pygame_module() -> Any:
    """Return pygame, imported without its greeting."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # else it greets on stdout
    return _extras.require("pygame", "render", "pictures of a chain")


def _points(name: str, value: object, least: int) -> FloatArray:
    out = _checks.array(name, value)
    if out.ndim != 2 or out.shape[1] != 2 or len(out) < least:
        raise ValueError(f"{name} must have shape (n, 2), n >= {least}, got shape {out.shape}")
    out.setflags(write=False)
    return out


@dataclass(frozen=True, eq=False)
class Scene:
    """What one picture shows; the pivot is at (0, 0), y points upwards."""

    positions: FloatArray  #: bobs from the pivot to the tip, of shape (n, 2) [m]
    reach: float  #: total length of the chain [m]; the disc of this radius is always in view
    time: float = 0.0  #: [s]
    energy: float = 0.0  #: above rest [J]
    pseudo_period: float = 0.0  #: [s]; zero: not measured yet
    completed: int = 0  #: number of bobs whose pseudo-period is complete
    torque: float = 0.0  #: at the base over its limit, in [-1, 1]; counter-clockwise is positive
    caption: str = ""  #: one line of text
    trace: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Earlier positions of the tip, oldest first, of shape (k, 2) [m]."""
    marks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Places to be dotted, such as turning points, of shape (k, 2) [m]."""

    def __post_init__(self) -> None:
        for name, least in (("positions", 1), ("trace", 0), ("marks", 0)):
            object.__setattr__(self, name, _points(name, getattr(self, name), least))
        _checks.positive_number("reach", self.reach)
        _checks.number("time", self.time)
        _checks.number("energy", self.energy)
        _checks.nonnegative_number("pseudo_period", self.pseudo_period)
        _checks.count("completed", self.completed, low=0, high=len(self.positions))
        if abs(_checks.number("torque", self.torque)) > 1.0:
            raise ValueError(f"torque must be between -1 and 1, got {self.torque!r}")
        if not str.isprintable(self.caption):
            raise ValueError(
                f"caption must be one printable line, got {_checks.show(self.caption)}"
            )


class Painter:
    """Paints scenes as square RGB arrays; holds nothing but the size, so it copies and pickles.

    The pivot is in the middle, and the reach has a radius of 0.44 times the width.

    Parameters
    ----------
    size : int
        Width and height in pixels, 32 to 2160; below 200 the text is left out.
    """

    def __init__(self, size: int = 480) -> None:
        self.size = _checks.count("size", size, low=32, high=2160)
        pygame_module()

    def place(self, pixel: Sequence[float]) -> FloatArray:
        """Return what the pixel (column, row) shows, over the reach: (x, y)."""
        middle = 0.5 * self.size
        return np.array([pixel[0] - middle, middle - pixel[1]]) * (1e3 / _RADIUS / self.size)

    def paint(self, scene: Scene) -> Frame:
        """Return the picture of `scene`, a new array of shape (size, size, 3)."""
        pg = pygame_module()
        canvas = pg.Surface((self.size * _SAMPLES, self.size * _SAMPLES), 0, 32)
        _draw(pg.draw, canvas, scene)
        picture = pg.transform.smoothscale(canvas, (self.size, self.size))
        if self.size >= 200:
            _write(pg.font, picture, scene)
        return np.ascontiguousarray(pg.surfarray.array3d(picture).transpose(1, 0, 2))


def _draw(draw: Any, canvas: Any, scene: Scene) -> None:
    unit = canvas.get_width() / 1000.0  # all lengths are in thousandths of the picture
    fine = max(1.0, 240.0 * _SAMPLES / canvas.get_width())  # keeps thin things visible
    n, middle = len(scene.positions), (500.0 * unit, 500.0 * unit)

    def disc(color: Sequence[int], center: Sequence[float], radius: float) -> None:
        draw.circle(canvas, color, center, radius * unit)

    def line(color: Sequence[int], start: Any, end: Any, width: float) -> None:
        draw.line(canvas, color, start, end, max(1, round(width * unit)))
        disc(color, end, width / 2.0)  # closes the gap at a bend

    def places(points: FloatArray) -> list[list[float]]:
        at = np.clip(points, -2.0 * scene.reach, 2.0 * scene.reach) / scene.reach
        return np.rint((500.0 + at * (_RADIUS, -_RADIUS)) * unit).tolist()

    canvas.fill(_PAPER)
    disc(_RIM, middle, _RADIUS + 1.0)
    disc(_DISC, middle, _RADIUS - 1.0)
    for outline in _arc_arrow(scene.torque) if scene.torque else ():
        draw.polygon(canvas, _TORQUE, ((500.0 + outline) * unit).tolist())

    track = np.vstack([scene.trace, scene.positions[-1:]])
    track = places(track[_thinned(len(track), _TRACE)])
    for k, (start, end) in enumerate(pairwise(track), start=1):
        line(_mixed((_DISC, _TIP), 0.08 + 0.52 * k / len(track)), start, end, 4.2 * fine)

    rod = _RADIUS / n  # on the average
    bob = min(max(0.29 * rod, 4.4 * fine), 21.0 * fine)
    tip, edge = max(1.15 * bob, 10.0 * fine), 2.5
    shown = _thinned(n, _BOBS)
    bobs = places(scene.positions[shown])
    for start, end in pairwise([middle, *bobs]):
        line(_ROD, start, end, min(max(0.42 * bob, 3.2 * fine), 7.0 * fine))
    for k, place in zip(shown[:-1].tolist(), bobs[:-1], strict=True):
        if 2.0 * (bob + edge) < rod:  # bobs that touch would cut each other
            disc(_DISC, place, bob + edge)
        disc(_mixed(_RAMP, k / n), place, bob)
    disc(_INK, middle, 9.0)
    disc(_DISC, middle, 4.0)
    disc(_DISC, bobs[-1], tip + edge)
    disc(_TIP, bobs[-1], tip)
    for place in places(scene.marks[_thinned(len(scene.marks), _BOBS)]):
        disc(_INK, place, min(0.45 * bob, 7.0 * fine))


def _arc_arrow(torque: float) -> tuple[FloatArray, FloatArray]:
    """Return shaft and head around the pivot; full torque is three quarters of a turn."""

    def polar(angle: Any, radius: Any) -> FloatArray:
        return np.stack([-radius * np.sin(angle), -radius * np.cos(angle)], axis=-1)

    turn = 1.5 * np.pi * torque
    head = min(max(turn, -0.5), 0.5)
    back = np.linspace(0.0, turn - head, 60)
    corners = polar(turn - head * np.array([1, 1, 0]), 57.0 + 28.0 * head * np.array([-1, 1, 0]))
    return np.vstack([polar(back, 53.0), polar(back[::-1], 61.0)]), corners


def _write(fonts: Any, picture: Any, scene: Scene) -> None:
    fonts.init()
    size = picture.get_width()
    font = fonts.Font(None, max(13, round(0.046 * size)))
    margin = round(0.018 * size)
    period = f"{scene.pseudo_period:.3f} s" if scene.pseudo_period else "-"
    period = f"T = {period} ({scene.completed}/{len(scene.positions)})"
    energy = f"E = {scene.energy:#.4g}".rstrip(".") + " J"
    rows = (scene.caption, f"t = {scene.time:.2f} s"), (energy, period)
    for (left, right), top in zip(rows, (margin, size - margin - font.get_height()), strict=True):
        start = size - margin - font.size(right)[0]
        room = (0, 0, start - 3 * margin, size)  # what does not fit is cut off
        picture.blit(font.render(left[:size], True, _INK), (margin, top), room)
        picture.blit(font.render(right, True, _INK), (start, top))


def _thinned(n: int, most: int) -> NDArray[np.int64]:
    """Return at most `most` of the indices below n, evenly, the last one among them."""
    return np.linspace(n - 1, 0, min(n, most)).round().astype(np.int64)[::-1]


def _mixed(colors: Sequence[Sequence[int]], part: float) -> list[int]:
    at = np.linspace(0.0, 1.0, len(colors))
    return [round(float(np.interp(part, at, channel))) for channel in zip(*colors, strict=True)]


def check_frame(name: str, value: object, shape: tuple[int, ...] = ()) -> Frame:
    """Return the picture `value`, refused where it is not uint8 or not of `shape`."""
    out = np.asarray(value)
    right = out.shape == shape if shape else out.ndim == 3 and out.shape[2] == 3 and out.size
    if out.dtype != np.uint8 or not right:
        wanted, got = shape or "(height, width, 3)", f"{out.dtype} of shape {out.shape}"
        raise ValueError(f"{name} must be uint8 of shape {wanted}, got {got}")
    return out


def tile(frames: Sequence[Frame]) -> Frame:
    """Return equal frames in a near-square grid, row by row."""
    _checks.count("number of frames", len(frames))
    height, width, _ = shape = check_frame("frames[0]", frames[0]).shape
    columns = math.ceil(math.sqrt(len(frames)))
    rows = math.ceil(len(frames) / columns)
    cells = np.full((rows * columns, *shape), _PAPER, dtype=np.uint8)
    for k, frame in enumerate(frames):
        cells[k] = check_frame(f"frames[{k}]", frame, shape)
    grid = cells.reshape(rows, columns, *shape).swapaxes(1, 2)
    return grid.reshape(rows * height, columns * width, 3)
