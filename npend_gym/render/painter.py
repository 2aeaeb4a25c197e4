"""Scenes painted as arrays, with their text; what a picture is, and several side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _extras
from npend_gym._palette import INK, PAPER, rgb
from npend_gym.render.drawing import SAMPLES, Scene, draw_scene

Frame = NDArray[np.uint8]


def pygame_module() -> Any:
    """Return pygame, imported without its greeting."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # else it greets on stdout
    return _extras.require("pygame", "render", "pictures of a chain")


class Painter:
    """Paints scenes as square RGB arrays; it keeps no picture, so it copies and pickles.

    The pivot is in the middle, and the reach has a radius of 0.44 times the width.

    Parameters
    ----------
    size : int
        Width and height in pixels, 32 to 2160; below 200 the text is left out.
    plain : bool
        Whether to draw only the chain and its cart, without text, trace, marks and arrows.
    """

    def __init__(self, size: int = 480, plain: bool = False) -> None:
        self.size: int = _checks.picture_size("size", size)
        self.plain: bool = _checks.truth("plain", plain)
        pygame_module()

    def paint(self, scene: Scene) -> Frame:
        """Return the picture of `scene`, a new array of shape (size, size, 3)."""
        pg = pygame_module()
        canvas = pg.Surface((self.size * SAMPLES, self.size * SAMPLES), 0, 32)
        draw_scene(pg.draw, canvas, _bare(scene) if self.plain else scene)
        picture = pg.transform.smoothscale(canvas, (self.size, self.size))
        if self.size >= 200 and not self.plain:
            _write(pg.font, picture, scene)
        return np.ascontiguousarray(pg.surfarray.array3d(picture).transpose(1, 0, 2))


def _bare(scene: Scene) -> Scene:
    """Return the scene with nothing but the chain and its cart."""
    none = np.empty((0, 2))
    return replace(scene, trace=none, marks=none, torque=0.0, force=0.0, push=0.0)


def _write(fonts: Any, picture: Any, scene: Scene) -> None:
    fonts.init()
    size = picture.get_width()
    font = fonts.Font(None, max(13, round(0.046 * size)))
    margin = round(0.018 * size)
    energy = f"E = {scene.energy:#.4g}".rstrip(".") + " J"
    room = size - 5 * margin - font.size(energy)[0]
    period = next((text for text in _periods(scene) if font.size(text)[0] <= room), "")
    rows = (scene.caption, f"t = {scene.time:.2f} s"), (energy, period)
    rows = (rows[0], ("", "")) if scene.beside else rows  # of several chains, each has its own
    for (left, right), top in zip(rows, (margin, size - margin - font.get_height()), strict=True):
        start = size - margin - font.size(right)[0]
        room = (0, 0, start - 3 * margin, size)  # what does not fit is cut off
        picture.blit(font.render(left[:size], True, rgb(INK)), (margin, top), room)
        picture.blit(font.render(right, True, rgb(INK)), (start, top))


def _periods(scene: Scene) -> tuple[str, ...]:
    """Captions for the pseudo-period, the longest first."""
    if scene.pseudo_period is None:
        return ()
    period, n = f"{scene.pseudo_period:.3f} s" if scene.pseudo_period else "-", len(scene.positions)
    short = f"pseudo-period: {period}"
    if n == 1:
        return (short,)
    of = f"{scene.completed} of {n} bobs"
    return f"pseudo-period, mean of {of}: {period}", f"pseudo-period ({of}): {period}", short


def check_frame(name: str, value: object, shape: tuple[int, ...] = ()) -> Frame:
    """Return the picture `value`, which must be uint8 and have `shape`."""
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
    cells = np.full((rows * columns, *shape), rgb(PAPER), dtype=np.uint8)
    for k, frame in enumerate(frames):
        cells[k] = check_frame(f"frames[{k}]", frame, shape)
    grid = cells.reshape(rows, columns, *shape).swapaxes(1, 2)
    return grid.reshape(rows * height, columns * width, 3)
