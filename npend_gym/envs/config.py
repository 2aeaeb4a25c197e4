"""The keywords of the environments: checked once, what depends on mode and chain filled in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from typing_extensions import Unpack

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Cart, Chain
from npend_gym.envs.goals import check_goal_env, goal_space
from npend_gym.envs.keywords import (
    DEFAULTS,
    EnvKeywords,
    action_table,
    check_mode,
    check_names,
    check_success,
    check_weight,
    checked_cart,
    described_chain,
    joints_of,
    motor_limit,
    width_of_starts,
    with_config_keywords,
)
from npend_gym.envs.limits import check_limits, check_seconds, substeps_of_step
from npend_gym.envs.modes import find_mode
from npend_gym.envs.randomization import Randomization, check_randomize
from npend_gym.envs.rows import MAX_CART_ENTRY, Task
from npend_gym.envs.settings import (
    DRAWN,
    HARDWARE,
    OF_CART,
    OF_SENSORS,
    RULES,
    EnvSettings,
)
from npend_gym.envs.values import CartOnRail, Motors, Sensors, unfolded
from npend_gym.physics.arguments import plain_angle
from npend_gym.physics.energy import sincos
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.substeps import (
    chain_of,
)

MAX_SCALED_SPEED = 2.0  # of the observation "scaled", whose faster rods are clipped


@with_config_keywords
@dataclass(frozen=True, eq=False, init=False)
class EnvConfig(EnvSettings):
    """The settings of an environment: its keywords, checked, and what follows from them.

    Parameters
    ----------
    **keywords
        Those of `NPendulumEnv`, all optional. As attributes they have the values that are used:
        `mode` is an instance, `dt` and `max_torque` are numbers, and `chain` has the masses,
        lengths and all other parameters of the chain. `max_episode_steps`, which `Policy.env` may
        have, is left to the environment.

    Attributes
    ----------
    randomization : Randomization
        What is drawn at every start.
    joints : ndarray, int64
        Actuated joints; none in a mode without a motor. With a cart the first is n: its force.
    min_substeps : int
        Substeps of a step in which no rod turns fast.
    max_rotation : float
        A substep in which a rod turns by more than this is divided [rad].
    speed_scale : ndarray, shape (n,)
        Angular velocities [rad/s] by which those observed are divided: 1, or for "scaled" that at
        which rod i alone, turning about its joint, has `Chain.lifting_energy`.
    action_table : ndarray, shape (actions, joints)
        Torques over their limit of each discrete action; empty where actions are continuous.
    largest : dict
        Of the settings of motors and sensors, the largest value that an episode may have.

    Raises
    ------
    TypeError, ValueError
        If a keyword breaks its rule.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> config = EnvConfig(n=3, mode="balance")
    >>> config.chain.n, config.dt
    (3, 0.02)
    """

    randomization: Randomization = field(init=False, repr=False)
    joints: NDArray[np.int64] = field(init=False, repr=False)
    min_substeps: int = field(init=False, repr=False)
    max_rotation: float = field(init=False, repr=False)
    speed_scale: FloatArray = field(init=False, repr=False)
    action_table: FloatArray = field(init=False, repr=False)
    largest: Mapping[str, float] = field(init=False, repr=False)

    def __init__(self, **given_keywords: Unpack[EnvKeywords]) -> None:
        own: dict[str, Any] = {**given_keywords}
        if (steps := own.pop("max_episode_steps", None)) is not None:
            _checks.count("max_episode_steps", steps)
        check_names(EnvConfig, own)
        keywords = unfolded(own)
        given: dict[str, Any] = DEFAULTS | keywords
        given |= {name: rule(name, given[name]) for name, rule in RULES.items()}
        chain = check_weight(described_chain(keywords))
        mode = check_mode(find_mode(given["mode"]))
        given |= checked_cart(chain, given, keywords, mode)
        on_cart = given["base"] == "cart"
        if on_cart:
            cart = Cart(given["cart_mass"], given["rail_damping"])
            chain = Chain.from_dict(chain.as_dict() | {"base": cart})
        if given["actuated"] is None:
            given["actuated"] = () if on_cart else (0,)
        joints = joints_of(given["actuated"], chain.n, least=0 if on_cart else 1)
        joints = () if mode.torque_share == 0.0 else (chain.n, *joints) if on_cart else joints
        given["dt"] = mode.dt if given["dt"] is None else _checks.positive_number("dt", given["dt"])
        given["measure_periods"] = _checks.truth(
            "measure_periods",
            mode.measures_periods if given["measure_periods"] is None else given["measure_periods"],
        )
        given["spread"] = width_of_starts(given["spread"], mode, given["max_tilt"], given["rail"])
        given["max_torque"] = motor_limit(given, "max_torque", mode, 0.5 * chain.lifting_energy)
        settings = {name: given[name] for name in DRAWN if on_cart or name not in OF_CART}
        random = check_randomize(given["randomize"], chain, settings)
        largest = {name: random.ends(name, given[name])[1] for name in HARDWARE}
        if "spread" in random.names:
            largest_spread = random.ends("spread", 0.0)[1]
            width_of_starts(largest_spread, mode, given["max_tilt"], given["rail"])
        if "amplitude" in random.names:
            plain_angle("amplitude", max(random.ends("amplitude", 0.0), key=abs))
        motors = sum(joint < chain.n for joint in joints)
        check_limits(largest, mode, given["dt"], motors)
        if on_cart and motors == 0 and "max_torque" in random.names:
            raise ValueError(
                "randomize must leave out 'max_torque' where no joint has a motor; 'max_force' is "
                "that of the cart, and actuated=(0,) gives a motor to the joint on it"
            )
        substeps, max_rotation = substeps_of_step(given["substeps"], given["dt"], random, given)
        if joints:
            for name, seconds in (("dt", given["dt"]), ("motor_lag", largest["motor_lag"])):
                check_seconds(name, seconds, chain)
        check_success(mode, given["reward_type"])
        check_goal_env(mode, given["reward_type"], goal_env=given["goal_env"])
        given["difficulty"] = None  # the limits have it
        used: dict[str, Any] = {each.name: given[each.name] for each in fields(EnvSettings)}
        vars(self).update(used | {
            "mode": mode,
            "chain": chain,
            "randomization": random,
            "joints": np.array(joints, np.int64),
            "min_substeps": substeps,
            "max_rotation": max_rotation,
            "speed_scale": _speed_scale(given["observation"], chain),
            "action_table": action_table(given["torque_levels"], mode, len(joints)),
            "largest": largest,
        })  # fmt: skip

    @property
    def motors(self) -> Motors:
        """The settings of the motors as one value."""
        return Motors.of(self)

    @property
    def sensors(self) -> Sensors:
        """The settings of the sensors as one value."""
        return Sensors.of(self)

    @property
    def cart(self) -> CartOnRail | None:
        """The settings of the cart as one value; None without one."""
        return CartOnRail.of(self) if self.has_cart else None

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.chain.n

    @property
    def with_all_features(self) -> Chain:
        """The chain, with its cart, that has every feature of the chains that may be drawn."""
        drawn = chain_of(self.randomization.with_all_features, 0).as_dict()
        return Chain.from_dict(drawn | {"base": self.chain.base})

    @property
    def with_sines(self) -> bool:
        """Whether observations hold the sines and cosines of the angles."""
        return self.observation != "angles"

    @property
    def speed_limit(self) -> float:
        """Bound of the angular velocities observed, to which they are clipped."""
        return MAX_SCALED_SPEED if self.observation == "scaled" else MAX_SPEED

    @property
    def hold_steps(self) -> int:
        """Number of steps over which the mode's goal must have held to count as success."""
        return math.ceil(self.mode.hold / self.dt * (1.0 - 1e-12))  # 5 s of 0.05 s are 100 steps

    @property
    def shows_state(self) -> bool:
        """Whether observations have the exact state: ideal sensors, and velocities."""
        return self.observe_velocities and not any(self.largest[each] > 0.0 for each in OF_SENSORS)

    @property
    def least_uprightness(self) -> float:
        """Cosine of `max_tilt`, by which a mode with `limits_tilt` ends; -inf without a limit."""
        if self.max_tilt is None or not self.mode.limits_tilt:
            return -math.inf
        return float(sincos(np.array([self.max_tilt]))[1][0])

    @property
    def render_fps(self) -> int:
        """Pictures a second at which an episode is shown in its own time."""
        return max(1, round(1.0 / self.dt))

    @property
    def action_space(self) -> spaces.Space[Any]:
        """Box(-1, 1) with an entry for each actuated joint, or Discrete; see `action_table`."""
        if self.joints.size == 0 or len(self.action_table) > 0:
            return spaces.Discrete(max(1, len(self.action_table)))
        return spaces.Box(-1.0, 1.0, (self.joints.size,), np.float32)

    @property
    def context_names(self) -> tuple[str, ...]:
        """What ``info["context"]`` holds, such as ("masses[0]", "masses[1]", "gravity")."""
        return self.randomization.names

    @property
    def _blocks(self) -> dict[str, tuple[int, float]]:
        """The blocks of an observation, in their order: number of entries, and their bound."""
        n, speeds = self.n, self.observe_velocities
        blocks: dict[str, tuple[int, float]] = {
            "angles": (0 if self.with_sines else n, np.pi),
            "sines": (n if self.with_sines else 0, 1.0),
            "cosines": (n if self.with_sines else 0, 1.0),
            "speeds": (n if speeds else 0, self.speed_limit),
            "cart": ((2 if speeds else 1) if self.has_cart else 0, MAX_CART_ENTRY),
            "goals": (n if self.observes_goals else 0, 1.0),
            "context": (len(self.context_names) if self.observe_context else 0, 1.0),
        }
        return {name: block for name, block in blocks.items() if block[0] > 0}

    @cached_property
    def columns(self) -> Mapping[str, slice]:
        """Where the blocks of an observation stand in it, in their order; those it has alone."""
        ends = np.cumsum([size for size, _ in self._blocks.values()]).tolist()
        return dict(zip(self._blocks, map(slice, [0, *ends], ends), strict=False))

    @property
    def observed(self) -> int:
        """Number of entries of an observation, without those of goals in a Dict."""
        return [*self.columns.values()][-1].stop

    @property
    def has_cart(self) -> bool:
        """Whether a cart carries the pivot."""
        return self.base == "cart"

    @property
    def cart_speed_factor(self) -> float:
        """What the velocity of a cart is multiplied by in observations [s/m]; 0 without one.

        A cart as fast as what has fallen through half of `rail` has 1 there.
        """
        if self.rail is None:
            return 0.0
        return 1.0 / math.sqrt((self.chain.gravity or STANDARD_GRAVITY) * self.rail)

    @property
    def state_size(self) -> int:
        """Number of entries of `NPendulumEnv.state`."""
        return 2 * self.n + (2 if self.has_cart else 0)

    @property
    def action_limits(self) -> FloatArray:
        """Force [N] or torque [N m] of the action 1, (joints,), in the order of `joints`."""
        limits = np.full(self.joints.size, self.max_torque)
        limits[self.joints == self.n] = self.max_force
        return limits

    @property
    def observes_goals(self) -> bool:
        """Whether the array observed has the goal; that of a Dict has none."""
        return self.mode.has_goals and not self.goal_env

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Angles (or sines and cosines), angular velocities, cart, goal, context; float32.

        With `goal_env` it is a Dict: see `NPendulumEnv`.
        """
        sizes, bounds = zip(*self._blocks.values(), strict=True)
        bound = np.repeat(bounds, sizes).astype(np.float32)
        box = spaces.Box(-bound, bound, dtype=np.float32)
        return goal_space(box, self.n) if self.goal_env else box


def make_config(env: type, keywords: EnvKeywords) -> EnvConfig:
    """Return the settings of an environment, or name the keyword that the environment lacks."""
    check_names(env, keywords)
    return EnvConfig(**keywords)


def task_numbers(
    config: EnvConfig, judge: int = 0, max_steps: int | None = None, **more: float
) -> FloatArray:
    """Entries of `rows.Task`; `judge` is the number of a built-in mode, 0 of others."""
    task = (
        {
            "MODE": judge,
            "MAX_STEPS": math.inf if max_steps is None else max_steps,
            "HOLD_STEPS": config.hold_steps,
            "SPEED_LIMIT": config.speed_limit,
            "SPARSE": config.reward_type == "sparse",
            "GOALS": config.mode.has_goals,
            "RAIL": config.rail or 0.0,
            "PER_CART_SPEED": config.cart_speed_factor,
            "UPRIGHTNESS": config.least_uprightness,
            "RAIL_WEIGHT": config.mode.rail_weight,
            "PIECES": 1,
            "NOISY": config.joints.size,
        }
        | {f"AFTER_{name.upper()}": own.stop for name, own in config.columns.items()}
        | more
    )
    return np.array([task.get(name, 0.0) for name in Task._fields], np.float64)


def _speed_scale(observation: str, chain: Chain) -> FloatArray:
    """Scales of angular velocities in observations [rad/s], shape (n,)."""
    scale = np.ones(chain.n)
    if observation == "scaled":
        scale = np.sqrt(2.0 * chain.lifting_energy / chain.repeated(1).joint_inertia[0])
    return scale
