"""A page on which the chain moves in the reader's browser: one HTML file, no network."""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _files, theory
from npend_gym._version import __version__
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.report import player

SUFFIXES = (".html",)
MAX_N = 100
# Bits of a weight, by the rods that are swung up: with these 256 of 256 starts succeed; with 8 in
# place of 10 two rods are swung up from 6 starts of 100, four from 52
_BITS = {2: 10, 3: 8, 4: 10}
_PACKED_BITS = 10
_DEGREES = 5, 175  # of the release: the ends of its slider
_SCRIPTS = (
    "pen.js",
    "diagram.js",
    *(f"live/{name}.js" for name in ("chain", "policy", "stage", "motion", "tell", "app")),
)
_STYLES = "page.css", "live/live.css"


class Network(NamedTuple):
    """A policy as the page takes it: float32 arrays, as those of `npend_gym.rl.Policy`."""

    n: int  # rods of the chain that it swings up
    scale: NDArray[np.float32]
    weights: Sequence[NDArray[np.float32]]
    biases: Sequence[NDArray[np.float32]]


class Engine(NamedTuple):
    """What computes the motion."""

    module: bytes  # WebAssembly
    layout: Mapping[str, Any]  # of the arrays that its functions take
    constants: Mapping[str, Any]  # of the physics and of the task of the networks


def write(engine: Engine, networks: Sequence[Network], angle: float, path: Path) -> Path:
    """Write `page` to `path`, whole or not at all."""
    text = page(engine, networks, angle)
    with _files.replacing(path) as file:
        file.write(text)
    return path


def page(engine: Engine, networks: Sequence[Network], angle: float) -> str:
    """Return the page as text; the chain is released from `angle` [rad] at first."""
    degrees = math.degrees(_checks.number("amplitude", angle))
    if not _DEGREES[0] <= degrees <= _DEGREES[1]:
        low, high = (math.radians(end) for end in _DEGREES)
        raise ValueError(f"amplitude must be between {low:.2f} and {high:.2f} rad, got {angle}")
    packed = [part for network in networks for part in _packed(network)]
    unit = [Chain.uniform(n, gravity=1.0) for n in range(1, MAX_N + 1)]
    factor = theory.pendulum_factor(np.radians(np.arange(_DEGREES[1] + 1)))
    data = {
        "layout": engine.layout,
        "physics": {"gravity": STANDARD_GRAVITY, **engine.constants},
        "law": [_short(theory.models(chain, 0.0).law) for chain in unit],
        "factor": [_short(one) for one in factor],
        "policies": [
            {
                "n": network.n,
                "shapes": [weight.shape for weight in network.weights],
                "scale": [_short(one) for one in network.scale],
            }
            for network in networks
        ],
        "module": _text(engine.module),
        "weights": _text(b"".join(packed)),
    }
    return player.page(
        "live/live.html",
        data,
        _SCRIPTS,
        _STYLES,
        version=__version__,
        most=MAX_N,
        angle=round(degrees),
        least_angle=_DEGREES[0],
        most_angle=_DEGREES[1],
        gravity=STANDARD_GRAVITY,
        motors="\n".join(_choice(network.n) for network in networks),
    )


def _choice(n: int) -> str:
    rods = f"{n} rods" if n > 1 else "1 rod"
    button = f'<input type="radio" name="motor" value="{n}"><span>{rods}</span>'
    return f"          <label>{button}</label>"


def _short(value: Any) -> float:
    return float(f"{float(value):.7g}")


def _packed(network: Network) -> list[bytes]:
    bits = _BITS.get(network.n, _PACKED_BITS)
    layers = zip(network.weights, network.biases, strict=True)
    return [pack(weight, bias, bits) for weight, bias in layers]


def _text(numbers: bytes) -> str:
    """Return numbers compressed, as text."""
    return base64.b64encode(zlib.compress(numbers, 9)).decode()


def pack(weight: NDArray[np.float32], bias: NDArray[np.float32], bits: int) -> bytes:
    """Return weights (outputs, inputs) and biases (outputs,) of a layer in a small form.

    Biases and a factor for each row as float32; then the weights over that factor, rounded to whole
    numbers of 10 bits, of which the first `bits` are used: the upper eight as int8, and then the
    two lower ones, of four weights in a byte.
    """
    largest, spare = np.abs(weight).max(axis=1), 1 << (_PACKED_BITS - bits)
    levels = spare * ((1 << (bits - 1)) - 1)
    factor = (np.where(largest > 0.0, largest, 1.0) / levels).astype("<f4")
    whole = (spare * np.round(weight / (spare * factor[:, None]))).astype(np.int16)
    high, low = (whole >> 2).astype("i1"), np.zeros(-(-whole.size // 4) * 4, np.uint8)
    low[: whole.size] = whole.ravel() & 3
    together = np.bitwise_or.reduce(low.reshape(-1, 4) << np.array([0, 2, 4, 6], np.uint8), axis=1)
    return bias.astype("<f4").tobytes() + factor.tobytes() + high.tobytes() + together.tobytes()
