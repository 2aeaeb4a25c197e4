"""A chain as a drawing with its data, for notebooks: SVG and HTML, without a library."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym._palette import INK, ORANGE, RAMP, ROD, mixed
from npend_gym.chain import Chain
from npend_gym.physics.energy import bodies, positions
from npend_gym.render.drawing import thinned

_SIZE, _MARGIN = 240.0, 18.0  # of the drawing, in its units
_LARGEST = 9.0  # radius of the heaviest bob; areas are as masses
_BEND = (1.1, 0.2)  # angles of the first and the last rod [rad]: none hides another
_MOST_LINKS, _MOST_ROWS = 200, 12
_UNITS = {
    "masses": "kg", "lengths": "m", "damping": "N m s/rad", "drag": "N s/m",
    "quadratic_drag": "N s^2/m^2", "centres": "m", "inertias": "kg m^2", "friction": "N m",
    "friction_speed": "rad/s", "armature": "kg m^2", "gear": "1", "stiffness": "N/m",
    "axial_damping": "N s/m",
}  # fmt: skip


def chain_html(chain: Chain) -> str:
    """Return a drawing of the chain to scale, and its parameters in a table."""
    title = f"Chain of {chain.n} link{'s' * (chain.n > 1)}, {chain.total_length:.4g} m long"
    return (
        '<div style="display: flex; flex-wrap: wrap; gap: 1.5em; align-items: center">'
        f"{chain_svg(chain, title)}<div>{_table(chain, title)}</div></div>"
    )


def chain_svg(chain: Chain, title: str) -> str:
    """Return the drawing: discs whose areas are as the masses, or bars with centres of mass."""
    theta = np.linspace(*_BEND, chain.n)
    ends = positions(chain, theta)
    centres = bodies(chain, theta)
    shown = thinned(chain.n, _MOST_LINKS)
    joints = np.vstack([np.zeros((1, 2)), ends[shown]])
    every = np.vstack([joints, centres])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = (_SIZE - 2 * _MARGIN) / max(float(np.ptp(every, axis=0).max()), 1e-300)

    def place(points: FloatArray) -> FloatArray:
        return _MARGIN + scale * (points - (low[0], high[1])) * (1.0, -1.0)

    at = place(joints)
    count, rods = len(shown), pairwise(at)
    if len(centres):
        tags = [_line(*rod, _ramp(k, count), 8.0) for k, rod in enumerate(rods)]
        tags += [_disc(point, 3.0, INK) for point in place(centres[shown])]
    else:
        tags = [_line(*rod, ROD, 2.0) for rod in rods]
        radii = _LARGEST * np.sqrt(chain.masses[shown] / chain.masses.max())
        radii = np.maximum(radii * min(1.0, 12.0 / count + 0.2), 1.2)
        tags += [
            _disc(point, radius, _ramp(k, count))
            for k, (point, radius) in enumerate(zip(at[1:], radii.tolist(), strict=True))
        ]
    tags.append(_disc(at[0], 3.5, INK))
    width, height = 2 * _MARGIN + scale * (high - low)
    return (
        f'<svg role="img" aria-label="{title}" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}">{"".join(tags)}</svg>'
    )


def _line(start: FloatArray, end: FloatArray, color: str, width: float) -> str:
    (x1, y1), (x2, y2) = start.tolist(), end.tolist()
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{color}" '
        f'stroke-width="{width}" stroke-linecap="round"/>'
    )


def _disc(center: FloatArray, radius: float, color: str) -> str:
    x, y = center.tolist()
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{color}"/>'


def _ramp(k: int, count: int) -> str:
    """Return the colour of link k: from blue at the pivot to amber, the last one orange."""
    return ORANGE if k == count - 1 else "#" + bytes(mixed(RAMP, k / count)).hex().upper()


def _table(chain: Chain, title: str) -> str:
    """Return the parameters: a row for each link, or one for all where they are equal."""
    drags = ("drag", "quadratic_drag") if chain.has_drag else ()
    damping = ("damping",) if chain.damping.any() else ()
    springs = ("stiffness", "axial_damping") if chain.stiffness is not None else ()
    names = ["masses", "lengths", *damping, *drags, *springs, *chain.repeated(1).beyond_ideal()]
    base = "" if chain.base is None else f"; on a cart of {chain.base.mass:g} kg"
    columns = [np.asarray(getattr(chain, name)) for name in names]
    equal = chain.n > 1 and all(np.all(column == column[0]) for column in columns)
    rows = [("each", 0)] if equal else [(str(k), k) for k in range(min(chain.n, _MOST_ROWS))]
    heads = "".join(f"<th>{name} [{_UNITS[name]}]</th>" for name in names)
    body = "".join(
        f"<tr><th>{label}</th>{''.join(f'<td>{column[k]:.4g}</td>' for column in columns)}</tr>"
        for label, k in rows
    )
    if not equal and chain.n > _MOST_ROWS:
        body += f'<tr><td colspan="{len(names) + 1}">and {chain.n - _MOST_ROWS} more</td></tr>'
    return (
        f"<table><caption>{title}; gravity {chain.gravity:g} m/s^2{base}</caption>"
        f"<thead><tr><th>link</th>{heads}</tr></thead><tbody>{body}</tbody></table>"
    )
