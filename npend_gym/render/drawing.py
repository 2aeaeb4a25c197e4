"""What a picture shows, and how: circles, lines and areas, by drawing functions that are given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._palette import INK, ORANGE, PAPER, PINK, RAMP, RIM, ROD, WHITE, mixed, rgb

SAMPLES = 4  # drawn this many times larger and averaged down; only powers of two keep a color
RADIUS = 440.0  # of the reach, in thousandths of the picture; the rest is a strip for the text
_BOBS, _TRACE = 2000, 600  # drawn at most: more than anyone can tell apart
_ROUNDED = 4  # lines of the trace between two places

_TIP, _TORQUE, _PAPER, _DISC = map(rgb, (ORANGE, PINK, PAPER, WHITE))
_RIM, _ROD, _INK = map(rgb, (RIM, ROD, INK))


@dataclass(frozen=True, eq=False)
class Scene:
    """What one picture shows; (0, 0) is the pivot, or the middle of the rail; y points upwards."""

    positions: FloatArray  #: far ends of the rods, from the pivot to the tip, of shape (n, 2) [m]
    reach: float  #: length of what is shown [m]; the disc of this radius is always in view
    time: float = 0.0  #: [s]
    energy: float = 0.0  #: above rest [J]
    pseudo_period: float | None = None  #: mean [s]; zero: not complete yet; None: not asked for
    completed: int = 0  #: number of bobs whose pseudo-period is complete
    torque: float = 0.0  #: at `joint` over its limit, in [-1, 1]; counter-clockwise is positive
    caption: str = ""  #: one line of text
    trace: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Earlier positions of the tip, oldest first, of shape (k, 2) [m]."""
    marks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Places to be dotted, such as turning points, of shape (k, 2) [m]."""
    centres: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Centres of mass of links that are bodies, of shape (n, 2) [m]; none of point masses."""
    joint: int = 0  #: the joint with the motor; 0 is the pivot
    rail: float = 0.0  #: half the length of the rail of a cart [m]; zero: there is no cart
    cart: float = 0.0  #: where the cart, and so the pivot, is on it [m]
    force: float = 0.0  #: on the cart over its limit, in [-1, 1]; to the right is positive
    push: float = 0.0  #: on the tip over the largest one, in [-1, 1]; to the right is positive
    color: str = ""  #: "#RRGGBB" of the whole chain; by default links have colors of their own
    beside: tuple[Scene, ...] = ()  #: other chains, drawn behind with this reach

    def __post_init__(self) -> None:
        for name, least in (("positions", 1), ("trace", 0), ("marks", 0), ("centres", 0)):
            object.__setattr__(self, name, _points(name, getattr(self, name), least))
        if len(self.centres) not in (0, len(self.positions)):
            raise ValueError(
                f"centres must have a place for each of the {len(self.positions)} links, or none, "
                f"got {len(self.centres)}"
            )
        _checks.positive_number("reach", self.reach)
        _checks.number("time", self.time)
        _checks.number("energy", self.energy)
        if self.pseudo_period is not None:
            _checks.nonnegative_number("pseudo_period", self.pseudo_period)
        _checks.nonnegative_number("rail", self.rail)
        _checks.number("cart", self.cart)
        _checks.count("completed", self.completed, low=0, high=len(self.positions))
        for name in ("torque", "force", "push"):
            if abs(_checks.number(name, getattr(self, name))) > 1.0:
                raise ValueError(f"{name} must be between -1 and 1, got {getattr(self, name)!r}")
        _checks.count("joint", self.joint, low=0, high=len(self.positions) - 1)
        caption: Any = self.caption
        if not isinstance(caption, str) or not caption.isprintable():
            raise ValueError(f"caption must be one printable line, got {_checks.show(caption)}")


def _points(name: str, value: object, least: int) -> FloatArray:
    out = _checks.array(name, value)
    if out.ndim != 2 or out.shape[1] != 2 or len(out) < least:
        raise ValueError(f"{name} must have shape (n, 2), n >= {least}, got shape {out.shape}")
    out.setflags(write=False)
    return out


def draw_scene(draw: Any, canvas: Any, scene: Scene) -> None:
    """Draw `scene` on a surface of pygame."""
    pen = _Pen(draw, canvas, scene.reach, scene.cart)
    canvas.fill(_PAPER)
    pen.disc(_RIM, pen.middle, RADIUS + 1.0)
    pen.disc(_DISC, pen.middle, RADIUS - 1.0)
    for other in scene.beside:
        _draw_chain(_Pen(draw, canvas, scene.reach, other.cart), other)
    _draw_chain(pen, scene)


def _draw_chain(pen: _Pen, scene: Scene) -> None:
    """Draw a chain, and all that belongs to it."""
    if scene.rail > 0.0:
        _draw_cart(pen, scene)
    motor = pen.places(_joints(scene)[scene.joint, None])[0]
    for outline in _arc_arrow(scene.torque) if scene.torque else ():
        pen.polygon(_TORQUE, motor, outline)

    track = np.vstack([scene.trace, scene.positions[-1:]])
    track = pen.places(_rounded(track[thinned(len(track), _TRACE)]))
    for k, (start, end) in enumerate(pairwise(track), start=1):
        share = 0.08 + 0.52 * k / len(track)
        pen.line(mixed((_DISC, _tint(scene, 1.0)), share), start, end, 4.2 * pen.fine)

    bob = min(max(0.29 * RADIUS / len(scene.positions), 4.4 * pen.fine), 21.0 * pen.fine)
    (_draw_links if len(scene.centres) else _draw_bobs)(pen, scene, bob)
    if scene.push:  # the arrow ends at the tip
        length = 60.0 + 140.0 * abs(scene.push)
        back = length + 26.0 + 1.6 * bob
        for outline in _arrow(-back, math.copysign(length, scene.push)):
            pen.polygon(_INK, pen.places(scene.positions[-1:])[0], outline)
    for place in pen.places(scene.marks[thinned(len(scene.marks), _BOBS)]):
        pen.disc(_INK, place, min(0.45 * bob, 7.0 * pen.fine))


def _rounded(track: FloatArray) -> FloatArray:
    """Return places (k, 2) at equal intervals of time with more between them, on smooth curves.

    They are cubics with the slopes of Catmull and Rom; straight lines would show their corners.
    """
    parts = min(_ROUNDED, _TRACE // len(track))
    if len(track) < 3 or parts < 2:
        return track
    (a, b), (u, v) = ((each[:-1], each[1:]) for each in (track, np.gradient(track, axis=0)))
    s = np.arange(parts)[:, None, None] / parts
    between = a + s * (u + s * (3.0 * (b - a) - 2.0 * u - v + s * (2.0 * (a - b) + u + v)))
    return np.vstack([between.swapaxes(0, 1).reshape(-1, 2), track[-1:]])


def _tint(scene: Scene, share: float) -> tuple[int, ...]:
    """Return the color of what is at a share of the chain, 1 at its tip."""
    return rgb(scene.color) if scene.color else _TIP if share == 1.0 else mixed(RAMP, share)


def _joints(scene: Scene) -> FloatArray:
    """Return the places of all joints and of the tip [m], (n + 1, 2)."""
    return np.vstack([(scene.cart, 0.0), scene.positions])


def _draw_cart(pen: _Pen, scene: Scene) -> None:
    """Draw rail, cart, and the force on it: an arrow as long as half the picture at its limit."""
    ends = pen.places(np.array([[-scene.rail, 0.0], [scene.rail, 0.0]]))
    pen.line(_RIM, ends[0], ends[1], 6.0)
    for end in ends:
        pen.polygon(_ROD, end, np.array([[-3, -26], [3, -26], [3, 26], [-3, 26]]))
    box = np.array([[-46, -20], [46, -20], [46, 20], [-46, 20]])
    pen.polygon(_ROD, pen.pivot, box)
    for outline in _arrow(46.0, 250.0 * scene.force) if scene.force else ():
        pen.polygon(_TORQUE, pen.pivot, outline)


def _draw_bobs(pen: _Pen, scene: Scene, bob: float) -> None:
    """Draw discs of radius `bob` on thin rods."""
    n = len(scene.positions)
    tip, edge = max(1.15 * bob, 10.0 * pen.fine), 2.5
    shown = thinned(n, _BOBS)
    bobs = pen.places(scene.positions[shown])
    rod = mixed((_DISC, rgb(scene.color)), 0.6) if scene.color else _ROD
    for start, end in pairwise([pen.pivot, *bobs]):
        pen.line(rod, start, end, min(max(0.42 * bob, 3.2 * pen.fine), 7.0 * pen.fine))
    for k, place in zip(shown[:-1].tolist(), bobs[:-1], strict=True):
        if 2.0 * (bob + edge) < RADIUS / n:  # bobs that touch would cut each other
            pen.disc(_DISC, place, bob + edge)
        pen.disc(_tint(scene, k / n), place, bob)
    pen.disc(_INK, pen.pivot, 9.0)
    pen.disc(_DISC, pen.pivot, 4.0)
    pen.disc(_DISC, bobs[-1], tip + edge)
    pen.disc(_tint(scene, 1.0), bobs[-1], tip)


def _draw_links(pen: _Pen, scene: Scene, bob: float) -> None:
    """Draw bars from joint to joint, a light pin in each joint and a dot at the centre of mass."""
    n = len(scene.positions)
    joints = _joints(scene)
    width, pin = 0.8 * bob, 0.36 * bob
    shown = [int(k) for k in thinned(n, _BOBS)]
    ends, centres = pen.places(joints), pen.places(scene.centres)
    for k in shown:
        color = _tint(scene, 1.0 if k == n - 1 else k / n)
        # a centre of mass beyond a joint is on an arm of the same body
        pen.line(_ROD, ends[k], centres[k], 0.5 * width)
        pen.bar(_DISC, ends[k], ends[k + 1], width + 2.5)
        pen.bar(color, ends[k], ends[k + 1], width)
    for k in shown:
        pen.disc(_INK, centres[k], 0.62 * width)
        pen.disc(_DISC, centres[k], 0.30 * width)
    for k in shown:
        pen.disc(_DISC, ends[k], pin)
    pen.disc(_INK, pen.pivot, 9.0)
    pen.disc(_DISC, pen.pivot, 4.0)


class _Pen:
    """Draws on a canvas; all lengths are in thousandths of the picture."""

    def __init__(self, draw: Any, canvas: Any, reach: float, cart: float) -> None:
        self._draw, self._canvas, self._reach = draw, canvas, reach
        self.unit = canvas.get_width() / 1000.0
        self.fine = max(1.0, 240.0 * SAMPLES / canvas.get_width())  # keeps thin things visible
        self.middle = (500.0 * self.unit, 500.0 * self.unit)
        self.pivot = self.places(np.array([[cart, 0.0]]))[0]

    def places(self, points: FloatArray) -> list[list[float]]:
        """Return where points [m] are on the canvas."""
        at = np.clip(points, -2.0 * self._reach, 2.0 * self._reach) / self._reach
        return np.rint((500.0 + at * (RADIUS, -RADIUS)) * self.unit).tolist()

    def disc(self, color: Sequence[int], center: Sequence[float], radius: float) -> None:
        self._draw.circle(self._canvas, color, center, radius * self.unit)

    def line(self, color: Sequence[int], start: Any, end: Any, width: float) -> None:
        self._draw.line(self._canvas, color, start, end, max(1, round(width * self.unit)))
        self.disc(color, end, width / 2.0)  # closes the gap at a bend

    def bar(self, color: Sequence[int], start: Any, end: Any, radius: float) -> None:
        """Draw a bar with round ends."""
        along = np.subtract(end, start)
        length = float(np.hypot(*along))
        if length > 0.0:
            across = np.array([-along[1], along[0]]) * (radius * self.unit / length)
            corners = [start + across, end + across, end - across, start - across]
            self._draw.polygon(self._canvas, color, np.array(corners).tolist())
        self.disc(color, start, radius)
        self.disc(color, end, radius)

    def polygon(self, color: Sequence[int], center: Any, outline: FloatArray) -> None:
        """Draw an area whose outline is given about its center."""
        self._draw.polygon(self._canvas, color, (outline * self.unit + center).tolist())


def _arrow(start: float, length: float) -> tuple[FloatArray, FloatArray]:
    """Return shaft and head of an arrow to the right, or to the left where `length` is negative."""
    end = start + abs(length)
    shaft = np.array([[start, -5], [end, -5], [end, 5], [start, 5]])
    head = np.array([[end, -15], [end + 26, 0], [end, 15]])
    side = (math.copysign(1.0, length), 1.0)
    return shaft * side, head * side


def _arc_arrow(torque: float) -> tuple[FloatArray, FloatArray]:
    """Return shaft and head around a joint; full torque is three quarters of a turn."""

    def polar(angle: Any, radius: Any) -> FloatArray:
        return np.stack([-radius * np.sin(angle), -radius * np.cos(angle)], axis=-1)

    turn = 1.5 * np.pi * torque
    head = min(max(turn, -0.5), 0.5)
    back = np.linspace(0.0, turn - head, 60)
    corners = polar(turn - head * np.array([1, 1, 0]), 57.0 + 28.0 * head * np.array([-1, 1, 0]))
    return np.vstack([polar(back, 53.0), polar(back[::-1], 61.0)]), corners


def thinned(n: int, most: int) -> NDArray[np.int64]:
    """Return at most `most` of the indices below n, evenly, the last one among them."""
    return np.linspace(n - 1, 0, min(n, most)).round().astype(np.int64)[::-1]
