"""Pages for a browser, each in one text: releases, campaigns, motions, pendulums to play with."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from npend_gym import _files
from npend_gym._checks import FloatArray
from npend_gym._palette import AMBER, BLUE, GREEN, ORANGE, PINK, RAMP, SKY
from npend_gym._version import __version__
from npend_gym.chain import Chain

SUFFIXES = (".html",)  # of a page
_SHARED = "common.js", "stage.js"
_COMMENTS = re.compile(  # left out of pages
    r"^ *(?://.*|/\*\*(?:.|\n)*?\*/)\n| +// .*", re.MULTILINE
)
_PALETTE = {"ramp": RAMP, "tip": ORANGE}
_DECIMALS = 4  # kept of the places, in units of the chain's length
# Name of a colour in the page: colour on light and on dark paper
_COLORS = {
    "blue": (BLUE, SKY), "orange": (ORANGE, ORANGE), "amber": ("#B87700", AMBER),
    "green": (GREEN, GREEN), "pink": ("#A8487B", PINK),
}  # fmt: skip

# How the models of the pseudo-period look in diagrams, in the order of `theory.Models`
MODELS = {
    "T0": {"color": "orange", "style": ""},
    "T0+a": {"color": "amber", "style": "dashed"},
    "T1": {"color": "green", "style": ""},
    "T(N,a)": {"color": "pink", "style": ""},
}
ABOUT_MODELS = {
    "T0": "The paper's formula: the period of one pendulum as long as the chain, for small angles.",
    "T0+a": "T0, longer by as much as the period of a single pendulum is longer from this angle.",
    "T1": "The period of the slowest normal mode: the slowest swing that repeats, if small.",
    "T(N,a)": "The law of the centre of mass: its period for small angles, longer as T0+a is.",
}


def extent(chain: Chain, positions: FloatArray) -> float:
    """Return how far from its pivot a chain reaches [m]; on springs, at places (T, n, 2)."""
    return max(chain.total_length, float(np.hypot(*positions.T).max()))


def moving(
    places: FloatArray, interval: float, centres: Sequence[float], cart: FloatArray | None = None
) -> dict[str, Any]:
    """Return a motion as the player reads it.

    The places of the bobs, (T, n, 2), and of a cart, (T,), are those at every `interval` [s], over
    the largest extent of the chain; for `centres` see there.
    """
    bodies = places
    if cart is not None:
        pivots = np.stack([cart, np.zeros_like(cart)], axis=-1)
        bodies = np.concatenate([pivots[:, None], places], axis=1)
    rounded = np.round(bodies, _DECIMALS).astype("<f4")
    return {
        "n": places.shape[1],
        "onCart": cart is not None,
        "interval": interval,
        "places": base64.b64encode(rounded.tobytes()).decode(),
        "centres": centres,
    }


def centres(motion: Any) -> list[float]:
    """Return where the centres of mass are along links that are bodies, over their lengths."""
    chain = motion.chain
    return (chain.centres / chain.lengths).tolist() if motion.bodies().size else []


def page(
    body: str,
    data: Mapping[str, Any] | None = None,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = ("page.css",),
    *,
    title: str,
    **texts: object,
) -> str:
    """Return a page in one text with all that it needs; files are those of the folder `browser`.

    Parameters
    ----------
    body : str
        File with what the page shows, and places such as ``$about`` for `texts`.
    data : mapping, optional
        What the scripts show; they are given the palette too. Without it the page has no scripts.
    scripts, styles : sequence of str
        Files, in the order in which they stand in the page, after those that all pages share.
    title : str
        HTML, as are all texts.
    **texts : object
        What stands in the places of `body`; that of ``$title`` and ``$version`` is known.
    """
    known = {"title": title, "version": __version__}
    return _template("document.html").substitute(
        known,
        style=palette_css() + "".join(map(_read, styles)),
        body=_template(body).substitute(known, **texts),
        scripts="" if data is None else _scripts(data, scripts),
    )


def _scripts(data: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return the elements with the data of a page and what shows them."""
    code = _COMMENTS.sub("", "".join(map(_read, (*_SHARED, *names))))
    return (
        f'<script type="application/json" id="data">{as_json({**data, "palette": _PALETTE})}'
        f'</script>\n<script type="module">\n{code}\n</script>\n'
    )


def table(heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as an HTML table, in which all texts are escaped."""
    shown = "".join(f'<th scope="col">{html.escape(head)}</th>' for head in heads)
    cells = (map(_cell, row) for row in rows)
    body = "".join(f"<tr>{''.join(row)}</tr>\n" for row in cells)
    return f"<table>\n<thead><tr>{shown}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>"


def _cell(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str("-" if value is None else value)
    return f"<td>{html.escape(text)}</td>"


def write(path: Path, text: str) -> None:
    """Write a page to `path`, whole or not at all."""
    with _files.replacing(path) as file:
        file.write(text)


def playback(choice: str, *, hidden: bool = False) -> str:
    """Return the controls of `player.js`; `choice` is what a motion is called there."""
    return _template("playback.html").substitute(choice=choice, hidden=" hidden" if hidden else "")


def _template(name: str) -> Template:
    return Template(_read(name))


def _read(name: str) -> str:
    return (files("npend_gym.report") / "browser" / name).read_text("utf-8")


def as_json(data: Mapping[str, Any]) -> str:
    """Return data as the content of a script element, which no "<" in a text can end."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def palette_css() -> str:
    """Return the colours of the page as variables of its style."""
    colors = (f"--{name}: light-dark({light}, {dark});" for name, (light, dark) in _COLORS.items())
    return f":root {{ {' '.join(colors)} }}\n"
