"""The keywords of the environments: their types, their defaults, and how they are read."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from numbers import Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import TypedDict

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_RODS, STANDARD_GRAVITY, Chain, ChainParameters, as_chain
from npend_gym.envs.modes import Mode, NearPose, described_modes
from npend_gym.envs.settings import (
    FIELDS,
    CartKeywords,
    MotorKeywords,
    SensorKeywords,
)
from npend_gym.envs.values import CartOnRail, Motors, Sensors, described
from npend_gym.physics.arguments import plain_angle

CHAIN_KEYWORDS = ChainParameters._fields  # the parameters of `Chain`
CART_KEYWORDS = [each.name for each in fields(CartOnRail)]
DIFFICULTIES = {"easy": 0.5, "medium": 0.2, "hard": 0.1}  # torque limit over the static torque
MAX_ACTIONS = 65_536  # of a discrete action space

_Class = TypeVar("_Class", bound=type)
_Weighed = TypeVar("_Weighed", Chain, ChainParameters)


class _FirstKeywords(TypedDict, total=False):
    n: int
    mode: str | Mode
    chain: Chain | Mapping[str, Any] | str | None
    masses: ArrayLike
    lengths: ArrayLike
    gravity: float
    damping: ArrayLike
    drag: ArrayLike
    quadratic_drag: ArrayLike
    centres: ArrayLike | None
    inertias: ArrayLike
    friction: ArrayLike
    friction_speed: ArrayLike
    armature: ArrayLike
    gear: ArrayLike
    base: str


class EnvKeywords(_FirstKeywords, MotorKeywords, CartKeywords, SensorKeywords, total=False):
    """The keywords that both environments take and `EnvConfig` describes."""

    dt: float | None
    substeps: int | None
    reward_type: str
    goal_env: bool
    max_tilt: float | None
    measure_periods: bool | None
    amplitude: float
    spread: float | None
    randomize: Mapping[str, Any] | None
    render_size: int
    render_plain: bool
    motors: Motors | Mapping[str, Any] | None
    sensors: Sensors | Mapping[str, Any] | None
    cart: CartOnRail | Mapping[str, Any] | None


DEFAULTS: dict[str, Any] = {"n": 2, "masses": 1.0, "lengths": 1.0} | {
    name: parameter.default
    for name, parameter in inspect.signature(Chain).parameters.items()
    if parameter.default is not parameter.empty and name in CHAIN_KEYWORDS
} | {name: each.default for name, each in FIELDS.items()}  # fmt: skip


def with_config_keywords(owner: _Class) -> _Class:
    """Give a class, for `help` and `inspect`, the signature and the parameters it really has."""
    own = inspect.signature(owner).parameters.values()
    given = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=DEFAULTS[name],
            annotation=getattr(kind, "__forward_arg__", kind),
        )
        for name, kind in EnvKeywords.__annotations__.items()
    ]
    positional = [p for p in own if p.kind is p.POSITIONAL_OR_KEYWORD]
    keyword_only = [p for p in own if p.kind is p.KEYWORD_ONLY]
    signature = inspect.Signature([*positional, *given, *keyword_only])
    owner.__signature__ = signature  # type: ignore[attr-defined]
    if owner.__doc__:  # python -OO has none
        owner.__doc__ = owner.__doc__.replace(_KEYWORDS, "\n".join(_described(given)))
        owner.__doc__ = owner.__doc__.replace(_MODES, "\n".join(described_modes()))
    return owner


# What stands in docstrings where these lists are to be, which help() and the pages then have
_KEYWORDS = "    **keywords\n        Listed by `help`."
_MODES = "    `help` lists them."


def _described(parameters: Sequence[inspect.Parameter]) -> Iterator[str]:
    """Yield the lines that describe keywords, in numpydoc's form."""
    yield "    n : int\n        Number of rods, or of the links of `chain`."
    yield f"    {', '.join(CHAIN_KEYWORDS)}\n        As in `npend_gym.Chain`."
    for each in parameters:
        if each.name in FIELDS:
            yield described(each.name, each.annotation)


# What other packages call a keyword
_OTHER_NAMES = {
    "N": "n", "num_links": "n", "n_links": "n", "num_rods": "n", "n_rods": "n", "num_poles": "n",
    "num_pendulums": "n", "mass": "masses", "length": "lengths", "g": "gravity", "timestep": "dt",
    "frame_skip": "substeps", "obs": "observation", "obs_type": "observation",
    "torque_limit": "max_torque", "task": "mode", "domain_randomization": "randomize",
}  # fmt: skip
_ELSEWHERE = {
    "seed": "; a seed is given to reset(seed=...).",
    "max_episode_steps": "; gym.make(..., max_episode_steps=...) takes it.",
}


def check_names(owner: type, keywords: Mapping[str, Any]) -> None:
    """Raise a TypeError that names the first keyword which `owner` lacks, and the nearest one."""
    for name in keywords:
        if name not in EnvKeywords.__annotations__:
            valid = list(inspect.signature(owner).parameters)
            other = _OTHER_NAMES.get(name)
            hint = f"; did you mean {other!r}?" if other else _checks.nearest(name, valid)
            hint = _ELSEWHERE.get(name, hint)
            raise TypeError(
                f"{owner.__name__} got an unexpected keyword argument {name!r}{hint} "
                f"It takes {', '.join(valid)}"
            )


def described_chain(keywords: Mapping[str, Any]) -> Chain:
    """Return the chain that `chain` or the keywords of its parameters describe."""
    own = {name: keywords[name] for name in CHAIN_KEYWORDS if name in keywords}
    given = keywords.get("chain")
    if given is None:
        n = _checks.count("n", keywords.get("n", _listed(own)), high=MAX_RODS)
        for name in ("masses", "lengths"):
            own[name] = _checks.vector(name, own.get(name, DEFAULTS[name]), n)
        return Chain(**own)
    chain = as_chain(given)
    if own:
        raise ValueError(
            f"{next(iter(own))} cannot be given together with chain, which has parameters of its "
            f"own: give either chain or {', '.join(CHAIN_KEYWORDS)}"
        )
    if _checks.count("n", keywords.get("n", chain.n), high=MAX_RODS) != chain.n:
        raise ValueError(
            f"n must be left out where chain is given, or be its number of links, {chain.n}; "
            f"got {_checks.show(keywords['n'])}"
        )
    return chain


def _listed(own: Mapping[str, Any]) -> int:
    """Return how many rods have a mass or a length of their own, or else the default number."""
    for name in ("masses", "lengths"):
        given: Any = own.get(name)
        if isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim == 1):
            values: Any = given  # pyright: ignore[reportUnknownVariableType]
            if 0 < len(values) <= MAX_RODS and all(isinstance(each, Real) for each in values):
                return len(values)
    return DEFAULTS["n"]


def check_weight(chain: _Weighed) -> _Weighed:
    """Return a chain, or the parameters of several, if it is higher standing than hanging.

    Tasks use the height of its centre of mass.
    """
    if not np.all(chain.lift.sum(axis=-1) > 0.0):
        raise ValueError(
            "centres must put the chain's centre of mass higher where all links stand than where "
            "all hang, because tasks use its height"
        )
    return chain


def joints_of(actuated: Any, n: int, least: int = 1) -> tuple[int, ...]:
    """Return the joints with a motor, of a chain of n rods, or say what is wrong with them."""
    if isinstance(actuated, str) or not isinstance(actuated, (Sequence, np.ndarray)):
        raise TypeError(
            f"actuated must be a list of joints such as (0,), got {_checks.show(actuated)}"
        )
    listed: list[Any] = list(actuated)  # pyright: ignore[reportUnknownArgumentType]
    joints = tuple(_checks.count("actuated", joint, low=0, high=n - 1) for joint in listed)
    if len(joints) < least or len(set(joints)) != len(joints):
        raise ValueError(
            f"actuated must name at least one joint, and each once, got {_checks.show(listed)}"
        )
    return joints


def motor_limit(keywords: Mapping[str, Any], name: str, mode: Mode, whole: float) -> float:
    """Return the torque or force of the action 1, as its keyword, `difficulty` or the mode says.

    `difficulty` is a fraction of `whole`, the static torque [N m] or the weight [N].
    """
    difficulty, given = keywords.get("difficulty"), keywords.get(name)
    if difficulty is None and given is None:
        return mode.torque_share * whole
    if difficulty is None:
        return _checks.nonnegative_number(name, given)
    shown = _checks.show(difficulty)
    if given is not None:
        raise ValueError(
            f"difficulty cannot be given together with {name}, because each sets the limit of a "
            f"motor: leave one out; got difficulty={shown} and {name}={_checks.show(given)}"
        )
    if mode.torque_share == 0.0:
        raise ValueError(
            f"difficulty must be left out in mode {mode.name!r}, which has no motor; got {shown}"
        )
    if not isinstance(difficulty, str):
        return _checks.positive_number("difficulty", difficulty) * whole
    if difficulty not in DIFFICULTIES:
        raise ValueError(
            f"difficulty must be one of {', '.join(DIFFICULTIES)}, or the torque limit as a "
            f"fraction of the static torque; got {shown}"
        )
    return DIFFICULTIES[difficulty] * whole


def check_mode(mode: Mode) -> Mode:
    """Return a mode, or say which of its attributes breaks the rule of keywords."""
    for old, new in (("nearness", "spread"), ("measures_com", "measures_periods")):
        if hasattr(mode, old):
            raise TypeError(f"{old} of mode {mode.name!r} must be named {new}")
    _checks.positive_number(f"dt of mode {mode.name!r}", mode.dt)
    for name in ("hold", "torque_share"):
        _checks.nonnegative_number(f"{name} of mode {mode.name!r}", getattr(mode, name))
    return mode


def check_success(mode: Mode, reward_type: str) -> None:
    """Raise a ValueError where the reward is the success of a mode that defines none."""
    if reward_type == "sparse" and not mode.defines_success:
        raise ValueError(
            f"achieved of mode {mode.name!r} must be defined for reward_type='sparse', which is 1 "
            "where it is True; without it, and without failed, the mode has no success"
        )


def width_of_starts(spread: Any, mode: Mode, max_tilt: float | None, rail: float | None) -> float:
    """Return `spread`, or that of the mode where it is None [rad]."""
    spread = _checks.nonnegative_number("spread", mode.spread if spread is None else spread)
    if isinstance(mode, NearPose) and spread > math.pi:
        raise ValueError(
            f"spread must be at most pi in mode {mode.name!r}, where pi to both sides is every "
            f"angle, got {spread:g}"
        )
    if isinstance(mode, NearPose) and mode.limits_tilt and spread >= (max_tilt or math.inf):
        raise ValueError(
            f"spread must be less than max_tilt, {max_tilt:g} rad, beyond which episodes end, got "
            f"{spread:g}: give a larger max_tilt, or None"
        )
    if isinstance(mode, NearPose) and rail is not None and mode.other_spread * spread >= rail:
        raise ValueError(
            f"spread must be less than {rail / mode.other_spread:g}, with which carts start up to "
            f"the ends of the rail, got {spread:g}: give a longer rail"
        )
    return plain_angle("spread", spread)


def checked_cart(
    chain: Chain, given: Mapping[str, Any], keywords: Mapping[str, Any], mode: Mode
) -> dict[str, Any]:
    """Return the keywords of the cart; `given` has all keywords, `keywords` those of the user.

    A chain that has a cart of its own brings its mass and damping.
    """
    if chain.stiffness is not None:
        raise ValueError(
            "chain must have rigid rods in an environment, because equal steps do not resolve the "
            f"vibrations of springs; chain.hung() has them, got {chain!r}"
        )
    if chain.base is not None and keywords.get("base", "cart") != "cart":
        raise ValueError(
            'base must be "cart", or left out, for a chain that has a cart of its own, got '
            f"{_checks.show(keywords['base'])}; chain.hung() has none"
        )
    if chain.base is None and given["base"] == "pivot":
        for name in CART_KEYWORDS:
            # an environment without a cart has a damping of 0, which `replace` gives again
            none = given[name] is None or (name == "rail_damping" and given[name] == 0.0)
            if not none:
                raise ValueError(
                    f'{name} belongs to a cart: give base="cart" with it, or leave it out; '
                    f"got {_checks.show(given[name])}"
                )
        return dict.fromkeys(CART_KEYWORDS) | {"rail_damping": 0.0}
    own = {"cart_mass": float(chain.masses.sum()), "rail": 2.0 * chain.total_length}
    own["rail_damping"] = 0.0
    if chain.base is not None:
        own |= {"cart_mass": chain.base.mass, "rail_damping": chain.base.damping}
    used = dict(given) | {k: value for k, value in own.items() if keywords.get(k) is None}
    checked = {name: _checks.positive_number(name, used[name]) for name in ("cart_mass", "rail")}
    gravity = chain.gravity or STANDARD_GRAVITY
    weight = gravity * (checked["cart_mass"] + float(chain.masses.sum()))
    return checked | {
        "base": "cart",
        "rail_damping": _checks.nonnegative_number("rail_damping", used["rail_damping"]),
        "max_force": motor_limit(given, "max_force", mode, weight),
    }


def action_table(torque_levels: Any, mode: Mode, joints: int) -> FloatArray:
    """Return the torques, over their limit, of each discrete action, shape (actions, joints).

    There are `torque_levels` evenly spaced torques for each joint; the last joint's changes
    fastest. The table is empty where actions are continuous.
    """
    if torque_levels is None:
        return np.empty((0, joints))
    levels = _checks.count("torque_levels", torque_levels, low=2, high=MAX_ACTIONS)
    if joints == 0:
        raise ValueError(
            f"torque_levels must be left out in mode {mode.name!r}, which has no motor; "
            f"got {levels}"
        )
    if levels**joints > MAX_ACTIONS:
        raise ValueError(
            f"torque_levels to the power of the actuated joints is the number of actions, and must "
            f"be at most {MAX_ACTIONS}; got {levels} ** {joints}"
        )
    each = np.indices((levels,) * joints, np.float64).reshape(joints, -1).T
    return (2.0 * each - (levels - 1.0)) / (levels - 1.0)
