"""The keywords of the environments: default, rule and description of each.

Their types stand in `keywords.EnvKeywords`. `config.EnvConfig` checks them and fills in what is
left out. From a keyword of an environment (`of_lane`) follow its row for kernels, its range in
`randomize` and its place in `get_state`.
"""

# ruff: noqa: RUF009  `keyword` returns a field
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from typing_extensions import TypedDict

from npend_gym import _checks
from npend_gym.physics.arguments import plain_angle
from npend_gym.physics.kernels.layout import MAX_SPEED

if TYPE_CHECKING:
    from npend_gym.chain import Chain
    from npend_gym.envs.modes import Mode

MAX_DELAY = 100.0  # steps; the states and actions of this many are kept
MAX_RIPPLE_CYCLES = 1000

Rule = Callable[[str, Any], Any]  # name, value -> the value that is used


class Limit(NamedTuple):
    """The largest value of a setting, with its unit or reason."""

    value: float
    why: str


def keyword(
    default: Any, text: str, rule: Rule | None = None, *, of_lane: bool = False,
    limit: Limit | None = None,
) -> Any:  # fmt: skip
    """Return a field for a keyword; `of_lane`: kernels read it, and each lane has a value of it."""
    about = {"text": text, "rule": rule, "of_lane": of_lane, "limit": limit}
    return field(default=default, metadata=about)


def _error(text: str, limit: Limit | None = None) -> Any:
    """Return a field for what an environment's motor or sensor does not do ideally; 0 is ideal."""
    return keyword(0.0, text, _checks.nonnegative_number, of_lane=True, limit=limit)


def _tilt(name: str, value: Any) -> float | None:
    """Return `value` as an angle from the upright [rad], or None."""
    if value is None:
        return None
    tilt = _checks.positive_number(name, value)
    if tilt > math.pi:
        raise ValueError(
            f"{name} must be at most pi [rad], got {tilt:g}: give radians, 36 degrees are "
            "math.radians(36), or None for no limit"
        )
    return tilt


_LATER = Limit(MAX_DELAY, "steps; make dt larger for a longer delay")


class MotorKeywords(TypedDict, total=False):
    """Types of the keywords of motors."""

    actuated: Sequence[int] | None
    max_torque: float | None
    difficulty: str | float | None
    torque_levels: int | None
    action_delay: float
    motor_lag: float
    torque_noise: float
    torque_ripple: float
    ripple_cycles: int
    push_rate: float
    push_force: float


@dataclass(frozen=True, eq=False, init=False)
class MotorSettings:
    """What acts on the chain: its motors, their errors, and pushes."""

    actuated: Sequence[int] = keyword(
        None,
        "Joints with a motor, in the order of the action; joint 0 is the pivot. By default (0,), "
        "and on a cart none.",
    )
    max_torque: float = keyword(
        None,
        "Torque of the action 1 [N m]; by default the static torque times a factor of the mode.",
        of_lane=True,
    )
    difficulty: Any = keyword(
        None,
        'Instead of `max_torque`, the limit over the static torque: 0.5 for "easy", 0.2 for '
        '"medium", 0.1 for "hard", or this number. Instead of `max_force`, the limit over the '
        "weight.",
    )
    torque_levels: int | None = keyword(
        None,
        "Makes actions discrete, with this many torques for each actuated joint, evenly spaced "
        "from -1 to 1. An action is a number to this base with a digit for each joint, the last "
        "joint's being the lowest.",
    )
    action_delay: float = _error(
        "Steps from an action to its torque, at most 100; a fraction is allowed.", _LATER
    )
    motor_lag: float = _error(
        "Time constant of the motors, which follow the action as a first-order system [s]."
    )
    torque_noise: float = _error(
        "Standard deviation of the noise of each motor's torque, drawn once a step [N m]."
    )
    torque_ripple: float = _error(
        "Cogging of the motors [N m]: torque_ripple sin(ripple_cycles phi), with phi the angle of "
        "the joint relative to the rod above."
    )
    ripple_cycles: int = keyword(
        6,
        "Cycles of the ripple a turn.",
        partial(_checks.count, high=MAX_RIPPLE_CYCLES),
        of_lane=True,
    )
    push_rate: float = _error(
        "Mean rate of pushes [1/s]. A push is a random horizontal force on the tip, for one step."
    )
    push_force: float = _error(
        "Largest force of a push [N]; forces are uniform between its negative and itself."
    )


class CartKeywords(TypedDict, total=False):
    """Types of the keywords of the cart."""

    max_force: float | None
    cart_mass: float | None
    rail: float | None
    rail_damping: float | None


@dataclass(frozen=True, eq=False, init=False)
class CartSettings:
    """The cart that carries the pivot."""

    max_force: float | None = keyword(
        None,
        "Force of the action 1 on a cart [N]; by default the weight of cart and chain, on Earth "
        "where there is no gravity, times the factor of the mode as for `max_torque`.",
        of_lane=True,
    )
    cart_mass: float | None = keyword(
        None,
        "Mass of the cart [kg]; by default that of the chain's own cart, or else the chain's.",
        of_lane=True,
    )
    rail: float | None = keyword(
        None,
        "How far the rail of a cart reaches to each side [m]; by default twice the length of the "
        "chain.",
    )
    rail_damping: float = keyword(
        None,
        "Viscous damping of the cart on its rail [N s/m]; by default that of the chain's own cart, "
        "or else 0.",
        of_lane=True,
    )


class SensorKeywords(TypedDict, total=False):
    """Types of the keywords of sensors."""

    observation: str
    observe_velocities: bool
    observe_context: bool
    angle_noise: float
    velocity_noise: float
    angle_resolution: float
    velocity_resolution: float
    observation_delay: float


@dataclass(frozen=True, eq=False, init=False)
class SensorSettings:
    """What the sensors show of the chain, and their errors."""

    observation: str = keyword(
        "angles",
        "The form of the observation, as in the table.",
        partial(_checks.choice, options=("angles", "sincos", "scaled")),
    )
    observe_velocities: bool = keyword(
        True,
        "Whether the velocities of rods and cart are observed. Without them the state is partially "
        "observed: a policy needs memory or stacked observations.",
        _checks.truth,
    )
    observe_context: bool = keyword(
        False,
        "Whether observations end with the numbers that `randomize` draws, scaled from their "
        "ranges to -1 to 1.",
        _checks.truth,
    )
    angle_noise: float = _error(
        "Standard deviation of the noise of observed angles [rad].",
        Limit(2.0 * math.pi, "rad, beyond which all angles are equally likely"),
    )
    velocity_noise: float = _error(
        "Standard deviation of the noise of observed angular velocities [rad/s].",
        Limit(MAX_SPEED, "rad/s"),
    )
    angle_resolution: float = _error(
        "Observed angles are multiples of it [rad]: 2 pi over the counts of an encoder per turn.",
        Limit(math.pi, "rad, two steps a turn"),
    )
    velocity_resolution: float = _error(
        "Observed angular velocities are multiples of it [rad/s].", Limit(MAX_SPEED, "rad/s")
    )
    observation_delay: float = _error(
        "Age of observations in steps, at most 100; a fraction is allowed.", _LATER
    )


@dataclass(frozen=True, eq=False, init=False)
class PictureSettings:
    """The pictures that `render` makes."""

    render_size: int = keyword(
        480,
        f"Width and height of a picture [pixels], 32 to {_checks.MAX_PICTURE_SIZE}. Pictures below "
        "200 have no text.",
        _checks.picture_size,
    )
    render_plain: bool = keyword(
        False,
        "Whether pictures show only the chain and its cart, without text, trace and arrows, as "
        "suits learning from pixels.",
        _checks.truth,
    )


@dataclass(frozen=True, eq=False, init=False)
class EnvSettings(PictureSettings, SensorSettings, CartSettings, MotorSettings):
    """All keywords but those of the chain, which `Chain` describes."""

    mode: Mode = keyword(
        "swingup",
        "The task. A task of your own is an instance of a class derived from `Mode`, or the name "
        'of that class, "package.module:Class"; only a name can be written to JSON with the spec.',
    )
    chain: Chain = keyword(
        None,
        "A `npend_gym.Chain`, the dict that its `as_dict` gives, a preset's name such as "
        '"acrobot" (`npend_gym.chain.PRESETS`), or a JSON file with such a dict, "fit.json". '
        "Without it, `n` and the parameters of the chain describe one.",
    )
    base: str = keyword(
        "pivot",
        "What the chain hangs from: a pivot at rest, or a cart on a horizontal rail. A chain that "
        "has a cart of its own, ``Chain(..., base=Cart(mass))``, stands on that, and needs no "
        "`base`.",
        partial(_checks.choice, options=("pivot", "cart")),
    )
    dt: float = keyword(None, "Time of a step [s]; by default that of the mode.")
    substeps: int | None = keyword(
        None,
        "Runge-Kutta steps in a step, always this many. By default there are enough for the "
        "fastest normal mode to turn by at most 1/16 rad in each, and more while a rod would turn "
        'by more than 1/20 rad. ``info["energy_error"]`` shows how well the energy is kept.',
    )
    reward_type: str = keyword(
        "dense",
        "As the section on rewards says.",
        partial(_checks.choice, options=("dense", "sparse")),
    )
    goal_env: bool = keyword(
        False,
        'In mode "transition", with reward_type="sparse": observations are a Dict with goals.',
        _checks.truth,
    )
    max_tilt: float | None = keyword(
        None,
        'In mode "balance", and modes of your own with `limits_tilt`: the largest angle of any rod '
        "from the upright [rad], beyond which the episode terminates. None: no limit. Benchmarks "
        "of two poles have 36 degrees, Gymnasium's CartPole has 12. Other modes do not use it.",
        _tilt,
    )
    measure_periods: bool = keyword(
        None,
        'Whether pseudo-periods are measured, and are in the info; by default in mode "passive" '
        "alone. Steps are faster without them.",
    )
    amplitude: float = keyword(math.pi / 4, "Angle of a release [rad].", plain_angle, of_lane=True)
    spread: float = keyword(
        None,
        "Width of the random starts [rad]: a release is from `amplitude` plus a draw from [0, "
        "spread); near an equilibrium, angles and velocities are drawn within it. By default that "
        "of the mode.",
        of_lane=True,
    )
    randomize: Mapping[str, Any] | None = keyword(
        None,
        "What is drawn at every start of an episode, by the name of a parameter of the chain, or "
        'of a setting of motors, sensors, cart or start, as "max_torque": a pair (low, high) of '
        'factors, or {"low": ..., "high": ...} of values. Each end is a number or has an entry for '
        'each rod. ``info["context"]`` has what was drawn. `npend_gym.envs.Randomize` is the same '
        "as a value.",
    )


# With values that hold several of them, which are no fields: `replace` would give both
FIELDS: dict[str, Field[Any]] = EnvSettings.__dataclass_fields__ | {
    "motors": keyword(
        None, "The keywords of motors as one value, `npend_gym.envs.Motors`, or the dict of it."
    ),
    "sensors": keyword(
        None, "The keywords of sensors as one value, `npend_gym.envs.Sensors`, or the dict of it."
    ),
    "cart": keyword(
        None,
        "The keywords of a cart as one value, `npend_gym.envs.CartOnRail`, or the dict of it.",
    ),
}
RULES: dict[str, Rule] = {
    name: rule for name, each in FIELDS.items() if (rule := each.metadata["rule"])
}
OF_LANES = [name for name, each in FIELDS.items() if each.metadata["of_lane"]]
OF_CART = [each.name for each in fields(CartSettings) if each.name in OF_LANES]
OF_STARTS = ["amplitude", "spread"]
# The errors of motors and sensors, all 0 where they are ideal, and the cycles of the ripple
HARDWARE = [name for name in OF_LANES if name not in (*OF_CART, *OF_STARTS, "max_torque")]
OF_SENSORS = [each.name for each in fields(SensorSettings) if each.name in HARDWARE]
COUNTED = ["ripple_cycles"]  # settings that nothing in between may be drawn of
DRAWN = [name for name in OF_LANES if name not in COUNTED]  # what `randomize` may draw
# What options of `reset` may change; they change no mechanism
OF_EPISODES = [name for name in DRAWN if name not in ("cart_mass", "rail_damping")]
OF_PUSHES = ["push_rate", "push_force"]
ERRORS_OF_MOTORS = [name for name in HARDWARE if name not in (*OF_SENSORS, *COUNTED, *OF_PUSHES)]
