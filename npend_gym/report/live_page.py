"""A page on which the chain moves in the reader's browser: one HTML file, no network."""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, theory
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.report import player

if TYPE_CHECKING:
    from npend_gym.rl import Policy

MAX_N = 100  # rods that the page has a slider for
_MOST_LINKS = 200  # of a chain that is given
# Bits of a weight, by the rods that are swung up: with these 256 of 256 starts succeed; with 8 in
# place of 10 two rods are swung up from 6 starts of 100, four from 52
_BITS = {2: 10, 3: 8, 4: 10}
_PACKED_BITS = 10
_DEGREES = 5, 175  # of the release: the ends of its slider
# Models of the pseudo-period: limit for small angles, and whether they depend on the angle, as the
# period of a single pendulum does
_MODELS = {
    "T0": ("ideal", False), "T0+a": ("ideal", True), "T1": ("fundamental", False),
    "T(N,a)": ("law", True),
}  # fmt: skip
_SCRIPTS = (
    "diagram.js", "periods.js", "chain.js", "policy.js", "motion.js", "tell.js", "lesson.js",
    "app.js",
)  # fmt: skip
_STYLES = "page.css", "live.css"
_CART_BY_KEYS = "the cart", "push the cart"
_PLOTS = "phase", "energies", "apart"
_FIGURE = (
    '<figure><svg id="{0}" aria-label="{0}" tabindex="0" role="application" '
    'aria-roledescription="diagram"></svg>'
    '<div class="tip" aria-live="polite"></div>'
    '<figcaption><span class="legend"></span></figcaption></figure>'
)


class Engine(NamedTuple):
    """What computes the motion."""

    module: bytes  # WebAssembly
    layout: Mapping[str, Any]  # of the arrays that its functions take
    constants: Mapping[str, Any]  # of the physics and of the task of the networks
    chain: Mapping[str, Any]  # the parameters of the chain that it is for


@dataclass(frozen=True)
class FirstState:
    """What the page shows at first.

    Parameters
    ----------
    angle : float
        Of the release [rad], 0.09 to 3.05; the page rounds it to a degree.
    n : int
        Number of equal rods, 1 to 100.
    chain : Chain, optional
        What moves, in place of rods that the reader chooses: at most 200 links.

    Raises
    ------
    ValueError
        If an argument breaks its rule, or the chain has springs.
    """

    angle: float
    n: int = 5
    chain: Chain | None = None

    def __post_init__(self) -> None:
        if not _DEGREES[0] <= math.degrees(_checks.number("amplitude", self.angle)) <= _DEGREES[1]:
            low, high = (math.radians(end) for end in _DEGREES)
            rule = _checks.in_radians(f"{low:.2f} to {high:.2f}", self.angle)
            raise ValueError(f"amplitude must be {rule}")
        _checks.count("n", self.n, high=MAX_N)
        if self.chain is None:
            return
        _checks.count("number of links", self.chain.n, high=_MOST_LINKS)
        if self.chain.stiffness is not None:
            raise ValueError(
                "chain must have no stiffness, to be played with: the page moves rigid rods"
            )


def page(engine: Engine, policies: Sequence[Policy], start: FirstState) -> str:
    """Return the page as text.

    Parameters
    ----------
    engine : Engine
        What computes: for the chain of `start`, where it has one.
    policies : sequence of Policy
        What the reader may let swing up rods; none beside a chain.
    start : FirstState
    """
    chain, models = start.chain, _models(start.chain)
    data = {
        "layout": engine.layout,
        "physics": {"gravity": STANDARD_GRAVITY, **engine.constants},
        "models": models,
        "chain": None if chain is None else engine.chain,
        "policies": [
            {
                "n": policy.env["n"],
                "shapes": [weight.shape for weight in policy.weights],
                "scale": [_short(one) for one in policy.scale],
                "output": policy.output,
            }
            for policy in policies
        ],
        "module": _text(engine.module),
        "weights": _text(b"".join(map(_packed, policies))),
    }
    cart = None if chain is None else chain.base
    joint, turn = ("the pivot", "turn the chain at the pivot") if cart is None else _CART_BY_KEYS
    return player.page(
        "live.html",
        data,
        _SCRIPTS,
        _STYLES,
        title="N pendulums, live",
        by_hand="" if chain is None else " hidden",
        chain="" if chain is None else _about(chain),
        pivot=joint,
        turn=turn,
        most=MAX_N,
        n=start.n,
        angle=round(math.degrees(start.angle)),
        least_angle=_DEGREES[0],
        most_angle=_DEGREES[1],
        gravity=STANDARD_GRAVITY,
        plots="\n".join(map(_FIGURE.format, _PLOTS)),
        models=_explained([each["name"] for each in models["each"]]),
        motors="\n".join(_choice(policy.env["n"]) for policy in policies),
    )


def _models(chain: Chain | None) -> dict[str, Any]:
    """Return the models of the pseudo-period under a gravity of 1 m/s^2, as the page reads them.

    The limits for small angles [s] are those of every number of equal rods, or of the chain alone.
    Models that depend on the angle are to be multiplied by the factor of that angle [degree]. There
    are none for a chain on a cart.
    """
    uniform = (Chain.uniform(n, gravity=1.0) for n in range(1, MAX_N + 1))
    chains = list(uniform) if chain is None else [chain]
    models = [theory.models(one, 0.0) for one in chains]
    limits = {
        name: [
            getattr(each, name) * math.sqrt(one.gravity)
            for each, one in zip(models, chains, strict=True)
        ]
        for name in ("ideal", "fundamental", "law")
    }
    shown = {
        name: list(map(_short, limit))
        for name, limit in limits.items()
        if all(map(math.isfinite, limit))
    }
    factors = theory.pendulum_factor(np.radians(np.arange(_DEGREES[1] + 1)))
    return {
        "limits": shown,
        "factors": [_short(factor) for factor in factors],
        "each": [
            {"name": name, **player.MODELS[name], "limit": limit, "bends": bends}
            for name, (limit, bends) in _MODELS.items()
            if limit in shown
        ],
    }


def _explained(names: Sequence[str]) -> str:
    """Return a list with a sentence on each model, and on the mean that stands beside them."""
    rows = [f"<dt>{name}</dt><dd>{player.ABOUT_MODELS[name]}</dd>" for name in names]
    return f'<dl class="models">{"".join(rows)}</dl>\n          ' if rows else ""


def _about(chain: Chain) -> str:
    text = f"A chain of {_count(chain.n, 'link')}, {chain.total_length:.4g} m long"
    return text if chain.base is None else f"{text}, on a cart of {chain.base.mass:.4g} kg"


def _count(n: int, name: str) -> str:
    return f"{n} {name}" if n == 1 else f"{n} {name}s"


def _choice(n: int) -> str:
    rods = _count(n, "rod")
    button = f'<input type="radio" name="motor" value="{n}"><span>{rods}</span>'
    return f"          <label>{button}</label>"


def _short(value: Any) -> float:
    return float(f"{float(value):.7g}")


def _packed(policy: Policy) -> bytes:
    bits = _BITS.get(policy.env["n"], _PACKED_BITS)
    layers = zip(policy.weights, policy.biases, strict=True)
    return b"".join(pack(weight, bias, bits) for weight, bias in layers)


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
