"""What stands beside the chain: the pseudo-periods as they complete, the models, the keys."""

from __future__ import annotations

import math

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym._palette import BLUE, GREEN, INK, ORANGE, PAPER, rgb
from npend_gym.chain import Chain
from npend_gym.render import Frame, pygame_module

SIZE, _PANEL = 560, 320  # pixels: height, and width of the panel
_INK, _PAPER, _BLUE, _ORANGE, _GREEN = map(rgb, (INK, PAPER, BLUE, ORANGE, GREEN))
_FAINT = rgb("#9AA3AC")
_HELP = (
    "mouse: pull a bob", "left, right: torque at the pivot", "space: pause    r: release again",
    "up, down: number of pendulums", "page up, page down: amplitude", "q: quit",
)  # fmt: skip


def draw_panel(chain: Chain, amplitude: float, periods: FloatArray) -> Frame:
    """Return the diagram of the pseudo-periods of all bobs, and the help text."""
    pg = pygame_module()
    pg.font.init()
    font = pg.font.Font(None, 21)
    panel = pg.Surface((_PANEL, SIZE), 0, 32)
    panel.fill(_PAPER)

    def write(text: str, left: float, top: float, color: tuple[int, int, int] = _INK) -> None:
        panel.blit(font.render(text, True, color), (left, top))

    periods_of = theory.models(chain, amplitude)
    known = (
        ("the paper's T0", periods_of.ideal, _ORANGE),
        ("slowest mode T1", periods_of.fundamental, _GREEN),
    )
    models = [model for model in known if math.isfinite(model[1])]
    left, right, low, high = 12.0, _PANEL - 14.0, 390.0, 100.0
    longest = 1.2 * max([1e-3, *periods, *(period for _, period, _ in models)])
    write(f"released from {math.degrees(amplitude):.0f} degrees", left, 12)
    for row, (name, period, color) in enumerate(models, start=1):
        at = low - (low - high) * period / longest
        pg.draw.line(panel, color, (left, at), (right, at), 2)
        write(f"{name}: {period:.3f} s", left, 12 + 22 * row, color)
    pg.draw.lines(panel, _FAINT, False, [(left, high), (left, low), (right, low)])
    for bob in np.flatnonzero(periods).tolist():
        at = left + (right - left) * (bob + 0.5) / chain.n
        up = low - (low - high) * float(periods[bob]) / longest
        pg.draw.aacircle(panel, _BLUE, (at, up), 4 if chain.n <= 40 else 2)
    write("pseudo-periods from the pivot to the tip", left, low + 6, _FAINT)
    for row, text in enumerate(_HELP):
        write(text, left, low + 34 + 21 * row)
    return np.ascontiguousarray(pg.surfarray.array3d(panel).transpose(1, 0, 2))
