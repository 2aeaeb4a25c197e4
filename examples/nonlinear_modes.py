"""Nonlinear normal modes of two to five pendulums, from 45 degrees to 2 rad: a table and a film.

Run it with `python examples/nonlinear_modes.py modes.gif`; it needs the extra "render", and takes a
minute. A second argument, `modes.gif 3`, is the largest number of pendulums.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont
from tqdm import tqdm

from npend_gym import Chain
from npend_gym.chaos import periodic_orbits

AMPLITUDES = np.pi / 4, 1.2, 1.6, 2.0  # rad, the largest angle of each release
CELL, MARGIN, SHARPNESS = 128, 30, 3  # pixels; drawn so many times as large, then made smaller
FRAMES, MILLISECONDS = 36, 50  # of a period, of a frame
BETWEEN = 4  # parts of the path of the tip, from frame to frame
STABLE, UNSTABLE, INK, FAINT = "#0072B2", "#D55E00", "#2B333B", "#C4CAD0"
# these and their mixtures with white
SHADES = [
    tuple(round(255 + part / 3 * (channel - 255)) for channel in ImageColor.getrgb(color))
    for color in (STABLE, UNSTABLE, INK, FAINT)
    for part in (3, 2, 1, 0)
]
PALETTE = Image.new("P", (1, 1))
PALETTE.putpalette([channel for shade in SHADES for channel in shade])


def draw_motion(pen, places, frame, centre, scale, color):
    """Draw one chain, and the path of its tip."""
    paths = centre + scale * places * [1.0, -1.0]
    pen.line([tuple(p) for p in paths[:, -1]], fill=FAINT, width=SHARPNESS)
    chain = [tuple(centre), *(tuple(p) for p in paths[BETWEEN * frame])]
    pen.line(chain, fill=INK, width=2 * SHARPNESS)
    for x, y in chain[1:]:
        r = 3.5 * SHARPNESS
        pen.ellipse((x - r, y - r, x + r, y + r), fill=color)


def draw_frame(orbits, amplitude, frame, columns):
    """Return a picture: a row for each number of pendulums, a column for each mode."""
    rows = sorted({orbit.chain.n for orbit, _ in orbits})
    size = SHARPNESS * columns * CELL, SHARPNESS * (len(rows) * CELL + MARGIN)
    picture = Image.new("RGB", size, "white")
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(12 * SHARPNESS)
    angle = f"the largest angle being {np.degrees(amplitude):.0f} degrees"
    title = f"Released from rest, {angle}. Blue: stable, orange: unstable"
    pen.text((10 * SHARPNESS, 8 * SHARPNESS), title, fill=INK, font=font)
    for orbit, places in orbits:
        n = orbit.chain.n
        left, top = orbit.mode * CELL, rows.index(n) * CELL + MARGIN
        centre = SHARPNESS * np.array([left + 0.5 * CELL, top + 0.35 * CELL])
        scale = SHARPNESS * 0.47 * CELL / orbit.chain.total_length
        color = STABLE if orbit.stable else UNSTABLE
        draw_motion(pen, places, frame, centre, scale, color)
        place = SHARPNESS * (left + 8), SHARPNESS * (top + CELL - 18)
        pen.text(place, f"{orbit.period:.2f} s", fill=color, font=font)
    small = picture.resize((size[0] // SHARPNESS, size[1] // SHARPNESS), Image.Resampling.LANCZOS)
    return small.quantize(palette=PALETTE, dither=Image.Dither.NONE)


out = Path(sys.argv[1] if len(sys.argv) > 1 else "nonlinear_modes.gif")
most = int(sys.argv[2]) if len(sys.argv) > 2 else 5
if most < 2:
    raise SystemExit(f"the largest number of pendulums must be at least 2, got {most}")
modes = [(n, mode) for n in range(2, most + 1) for mode in range(n)]

families = []
print(" N mode  amplitude  period [s]  energy [J]  largest multiplier  closed to")
for n, mode in tqdm(modes, unit="mode"):
    families.append(periodic_orbits(Chain.uniform(n), mode, amplitudes=AMPLITUDES))
    for orbit in families[-1]:
        largest = abs(orbit.multipliers[0])
        print(
            f"{n:2d} {mode:4d} {orbit.amplitude:10.3f} {orbit.period:11.4f} {orbit.energy:11.2f} "
            f"{largest:19.3f} {orbit.closure:10.0e}"
        )

pictures = []
for k, amplitude in enumerate(AMPLITUDES):
    samples = BETWEEN * FRAMES + 1
    shown = [(orbits[k], orbits[k].motion(samples).positions()) for orbits in families]
    pictures += [draw_frame(shown, amplitude, frame, most) for frame in range(FRAMES)]
pictures[0].save(
    out, save_all=True, append_images=pictures[1:], duration=MILLISECONDS, loop=0, optimize=True
)
print(f"written: {out}")
