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
from npend_gym.chain import STANDARD_GRAVITY, Cart, Chain, ChainParameters
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
from npend_gym.envs.modes import Mode, find_mode
from npend_gym.envs.randomization import Randomization, check_randomize
from npend_gym.envs.rows import MAX_CART_ENTRY, Task
from npend_gym.envs.settings import (
    DRAWN,
    ERRORS_OF_MOTORS,
    FIELDS,
    HARDWARE,
    OF_CART,
    OF_SENSORS,
    RULES,
    Limit,
    Settings,
    angle,
)
from npend_gym.envs.values import CartOnRail, Motors, Sensors, unfolded
from npend_gym.physics.energy import sincos
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.substeps import (
    MAX_ROTATION,
    MAX_SUBSTEPS,
    chain_of,
    default_substeps,
    substeps_on_cart,
)

MAX_SCALED_SPEED = 2.0  # of the observation "scaled", whose faster rods are clipped
_OF_TORQUES = ("torque_noise", "torque_ripple")  # which the force on a cart has not


@with_config_keywords
@dataclass(frozen=True, eq=False, init=False)
class EnvConfig(Settings):
    """The settings of an environment: its keywords, checked, and what follows from them.

    Parameters
    ----------
    **keywords
        Those of `NPendulumEnv`, all optional. As attributes they have the values that are used:
        `mode` is an instance, `dt` and `max_torque` are numbers, and `chain` has the masses,
        lengths and all other parameters of the chain.

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
        check_names(EnvConfig, given_keywords)
        keywords = unfolded(given_keywords)
        given: dict[str, Any] = DEFAULTS | keywords
        given |= {name: rule(name, given[name]) for name, rule in RULES.items()}
        chain = check_weight(described_chain(keywords))
        mode = check_mode(find_mode(given["mode"]))
        given |= checked_cart(chain, given, keywords, mode)
        on_cart = given["base"] == "cart"
        if on_cart:
            own = Cart(given["cart_mass"], given["rail_damping"])
            chain = Chain.from_dict(chain.as_dict() | {"base": own})
        if given["actuated"] is None:
            given["actuated"] = () if on_cart else (0,)
        joints = joints_of(given["actuated"], chain.n, least=0 if on_cart else 1)
        joints = () if mode.torque_share == 0.0 else (chain.n, *joints) if on_cart else joints
        given["dt"] = mode.dt if given["dt"] is None else _checks.positive_number("dt", given["dt"])
        given["measure_periods"] = _checks.truth(
            "measure_periods",
            mode.measures_periods if given["measure_periods"] is None else given["measure_periods"],
        )
        given["spread"] = width_of_starts(given["spread"], mode, given["max_tilt"])
        given["max_torque"] = motor_limit(given, "max_torque", mode, 0.5 * chain.lifting_energy)
        settings = {name: given[name] for name in DRAWN if on_cart or name not in OF_CART}
        random = check_randomize(given["randomize"], chain, settings)
        largest = {name: random.ends(name, given[name])[1] for name in HARDWARE}
        if "spread" in random.names:
            width_of_starts(random.ends("spread", 0.0)[1], mode, given["max_tilt"])
        if "amplitude" in random.names:
            angle("amplitude", max(random.ends("amplitude", 0.0), key=abs))
        motors = sum(joint < chain.n for joint in joints)
        _check_limits(largest, mode, given["dt"], motors)
        if on_cart and motors == 0 and "max_torque" in random.names:
            raise ValueError(
                "randomize must leave out 'max_torque' where no joint has a motor; 'max_force' is "
                "that of the cart, and actuated=(0,) gives a motor to the joint on it"
            )
        substeps, max_rotation = _substeps(given["substeps"], given["dt"], random, given)
        if joints:
            for name, seconds in (("dt", given["dt"]), ("motor_lag", largest["motor_lag"])):
                _check_seconds(name, seconds, chain)
        check_success(mode, given["reward_type"])
        check_goal_env(mode, given["reward_type"], goal_env=given["goal_env"])
        given["difficulty"] = None  # the limits have it
        used: dict[str, Any] = {each.name: given[each.name] for each in fields(Settings)}
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
        return Motors(**{each.name: getattr(self, each.name) for each in fields(Motors)})

    @property
    def sensors(self) -> Sensors:
        """The settings of the sensors as one value."""
        return Sensors(**{each.name: getattr(self, each.name) for each in fields(Sensors)})

    @property
    def cart(self) -> CartOnRail | None:
        """The settings of the cart as one value; None without one."""
        own = {each.name: getattr(self, each.name) for each in fields(CartOnRail)}
        return CartOnRail(**own) if self.has_cart else None

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


def _check_seconds(name: str, seconds: float, chain: Chain) -> None:
    """Raise a ValueError for a time in which motors miss a swing: it may be in milliseconds."""
    if seconds >= 1.0 and chain.gravity > 0.0:
        most = math.pi * math.sqrt(chain.total_length / chain.gravity)
        if seconds > most:
            raise ValueError(
                f"{name} must be at most {most:.3g} s, half the period of a pendulum of the "
                "chain's length, so that motors act twice in a swing; "
                f"got {seconds:g} s: {seconds:g} ms are {seconds / 1000.0:g} s"
            )


def _check_limits(largest: Mapping[str, float], mode: Mode, dt: float, joints: int) -> None:
    """Raise a ValueError that names the first setting beyond its limit, for `joints` with a motor.

    `largest` has the settings, or the upper ends of their ranges where they are random.
    """
    often = Limit(1.0 / dt, "1/s, one a step; make dt smaller for more")
    for name in HARDWARE:
        limit = often if name == "push_rate" else FIELDS[name].metadata["limit"]
        if limit is not None and largest[name] > limit.value:
            raise ValueError(
                f"{name} must be at most {limit.value:g} {limit.why}; got {largest[name]:g}"
            )
    if (largest["push_rate"] > 0.0) != (largest["push_force"] > 0.0):
        raise ValueError(
            "push_rate and push_force must be given together, because a push needs both; got "
            f"push_rate={largest['push_rate']:g} and push_force={largest['push_force']:g}"
        )
    for name in ERRORS_OF_MOTORS:
        if mode.torque_share == 0.0 and largest[name] > 0.0:
            raise ValueError(
                f"{name} must be left out in mode {mode.name!r}, which has no motor; "
                f"got {largest[name]:g}"
            )
    for name in _OF_TORQUES:
        if joints == 0 and largest[name] > 0.0:
            raise ValueError(
                f"{name} must be left out where no joint has a motor; actuated=(0,) gives one to "
                f"the joint on the cart; got {largest[name]:g}"
            )


def _substeps(
    given: int | None, dt: float, random: Randomization, cart: Mapping[str, Any]
) -> tuple[int, float]:
    """Return the least number of substeps, and the rotation that divides one [rad]."""
    if given is not None:
        return _checks.count("substeps", given, high=MAX_SUBSTEPS), math.inf
    most = 1
    for corner in random.corners:
        chain = chain_of(corner, 0)
        most = max(most, substeps_on_base(default_substeps(chain, dt), chain, dt, random, cart))
    return most, MAX_ROTATION


def substeps_on_base(
    substeps: int, chains: Chain | ChainParameters, dt: float, random: Randomization,
    cart: Mapping[str, Any],
) -> int:  # fmt: skip
    """Return how many substeps chains need on any cart drawn, if on one, or else `substeps`."""
    if cart["base"] != "cart":
        return substeps
    mass = random.ends("cart_mass", cart["cart_mass"])[0]
    damping = random.ends("rail_damping", cart["rail_damping"])[1]
    return substeps_on_cart(substeps, chains, dt, 1.0 / mass, damping)


def _speed_scale(observation: str, chain: Chain) -> FloatArray:
    """Scales of angular velocities in observations [rad/s], shape (n,)."""
    scale = np.ones(chain.n)
    if observation == "scaled":
        scale = np.sqrt(2.0 * chain.lifting_energy / chain.repeated(1).joint_inertia[0])
    return scale
