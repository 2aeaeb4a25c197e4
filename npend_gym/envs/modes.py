"""The tasks: how an episode starts, what is rewarded, when it fails and when it succeeds.

A mode is given physical quantities and knows neither Gymnasium nor the integrator. Its formulas
use only operations that give the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from inspect import cleandoc
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from typing_extensions import NamedTuple  # that of Python 3.10 cannot be generic

from npend_gym import _checks
from npend_gym._checks import FloatArray

_T = TypeVar("_T")


class Quantities(NamedTuple, Generic[_T]):
    """What rewards and success are computed from: numbers, or arrays (B,) of a vector environment.

    Formulas of + - * /, abs and comparisons serve both. Energies are in units of
    `Chain.lifting_energy`, so that a reward means the same for every chain.
    """

    height: _T
    """Height of the centre of mass: 0 hanging, 1 upright."""
    tip: _T
    """Height of the tip above the pivot over the length of the chain, -1 to 1."""
    energy: _T
    """Energy above hanging at rest: 1 upright at rest, where all links hang by their weight."""
    kinetic_energy: _T
    """Its kinetic part."""
    energy_fraction: _T
    """Energy over that at the start of the episode (where that is 0: the energy itself)."""
    mean_squared_action: _T
    """Mean over the joints of the square of the clipped action, 0 to 1."""
    closeness: _T
    """1 - sum_i abs(h_i (cos theta_i - c_i)) / (2 sum_i abs(h_i)), with h of `Chain.lift` and c_i
    the cosine that the episode's goal has for rod i: 1 at the goal; the height where the goal is
    upright. 0 in a mode without goals."""
    goal_distance: _T
    """Largest abs(cos theta_i - c_i), 0 to 2; 0 in a mode without goals."""
    rail_position: _T
    """Place of the cart over `rail`: within -1 to 1 while it is on its rail; 0 without a cart."""
    uprightness: _T
    """Smallest -cos theta_i: 1 where all rods stand, below 0 where one is below the horizontal."""
    tip_distance: _T
    """Distance of the tip from where it is upright, over the length of the chain, 0 to 2."""
    cart_velocity: _T
    """Velocity of the cart [m/s]; 0 without a cart."""
    theta: FloatArray
    """Angles from the downward vertical, not wrapped [rad], shape (n,) or (B, n)."""
    omega: FloatArray
    """Angular velocities [rad/s], shape (n,) or (B, n)."""


class Mode:
    """The base of all tasks; derive from it for a task of your own.

    Pass an instance as ``mode=``, or the class by name, ``mode="package.module:Class"``: only a
    name can be written to JSON with an environment's spec.

    Attributes
    ----------
    name : str
    dt : float
        Default time of a step [s].
    torque_share : float
        Default torque limit, as a fraction of the torque that holds the whole chain horizontal,
        g sum_i h_i with h of `Chain.lift`. Zero: the mode has no motor.
    hold : float
        For how long [s] the goal must have held without interruption to count as success.
    has_goals : bool
        Whether each episode has a goal of its own: an equilibrium, with each rod hanging or
        standing.
    measures_periods : bool
        Whether pseudo-periods are measured where the keyword `measure_periods` is left out.
    limits_tilt : bool
        Whether the episode also terminates where a rod leans by more than the keyword `max_tilt`.
    spread : float
        Default width of the random starts [rad]; near an equilibrium also of velocities [rad/s].
    rail_weight : float
        By what share the reward is smaller where a cart is at an end of its rail.
    """

    name: ClassVar[str] = "custom"
    dt: ClassVar[float] = 0.05
    torque_share: ClassVar[float] = 0.5
    hold: ClassVar[float] = 0.0
    has_goals: ClassVar[bool] = False
    measures_periods: ClassVar[bool] = False
    limits_tilt: ClassVar[bool] = False
    spread: ClassVar[float] = 0.017
    rail_weight: ClassVar[float] = 0.5

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{type(self).__name__}({values})"

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Draw the starting angles [rad] and angular velocities [rad/s], each of shape (n,)."""
        raise NotImplementedError(f"mode {self.name!r} must define start")

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return the reward of the step, between 0 and 1."""
        raise NotImplementedError(f"mode {self.name!r} must define reward")

    def failed(self, quantities: Quantities[Any]) -> Any:
        """Return whether the episode has failed and so terminates; by default it never does."""
        del quantities
        return False

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether the goal is met at this instant; by default: whether it has not failed.

        ``info["success"]`` tells whether this has been so for the last `hold` seconds. A mode that
        defines neither `failed` nor `achieved` has no success, see `defines_success`.
        """
        return np.logical_not(self.failed(quantities))

    @property
    def defines_success(self) -> bool:
        """Whether the mode has a goal: it defines `achieved`, or `failed`."""
        return any(
            name in vars(self) or getattr(type(self), name) is not getattr(Mode, name)
            for name in ("achieved", "failed")
        )


class Release(Mode):
    """The base of the tasks that begin with a free release."""

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start at rest, all rods at `amplitude` plus one draw from [0, spread) that all share."""
        return np.full(n, amplitude + spread * rng.random()), np.zeros(n)


class NearPose(Mode):
    """The base of the tasks that begin near an equilibrium.

    Attributes
    ----------
    pose : float
        Angle of all rods there [rad].
    other_spread : float
        Width of the starting velocities and of the place of a cart, over `spread`.
    """

    pose: ClassVar[float]
    other_spread: ClassVar[float] = 1.0

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start with angles and angular velocities within `spread` of the equilibrium at rest."""
        del amplitude
        angles, velocities = rng.uniform(-spread, spread, (2, n))
        return self.pose + angles, self.other_spread * velocities


class Passive(Release):
    """The paper's experiment: a free release from rest; no torque, no reward, no failure."""

    name = "passive"
    measures_periods: ClassVar[bool] = True
    dt: ClassVar[float] = 0.01
    torque_share: ClassVar[float] = 0.0

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return 0."""
        return 0.0 * abs(quantities.height)  # abs: 0.0 times a negative number is -0.0

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return False: there is nothing to achieve."""
        return quantities.height != quantities.height


class SwingUp(NearPose):
    """From hanging nearly at rest to upright and slow.

    reward = height^2 (1 + calmness) / 2 (1 - mean_squared_action / 10), with
    calmness = 1 / (1 + 4 kinetic_energy)
    success: for 5 s, height > 0.95 and kinetic_energy < 0.01
    """

    name = "swingup"
    hold: ClassVar[float] = 5.0
    pose: ClassVar[float] = 0.0
    spread: ClassVar[float] = 0.05

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return the squared height of the centre of mass, halved where fast."""
        calmness = 1.0 / (1.0 + 4.0 * quantities.kinetic_energy)
        upright = quantities.height * quantities.height * (0.5 + 0.5 * calmness)
        return upright * (1.0 - 0.1 * quantities.mean_squared_action)

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether the chain is upright and slow."""
        return (quantities.height > 0.95) & (quantities.kinetic_energy < 0.01)


class Balance(NearPose):
    """Keep the upright chain up; fails when the tip falls below half its full height.

    With `max_tilt` it also fails when a rod leans by more.

    reward = max(tip, 0) (1 + calmness) / 2 (1 - mean_squared_action / 10)
    success: not failed
    """

    name = "balance"
    limits_tilt: ClassVar[bool] = True
    dt: ClassVar[float] = 0.02
    pose: ClassVar[float] = float(np.pi)
    spread: ClassVar[float] = 0.02

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return the height of the tip, halved where fast."""
        upright = 0.5 * (quantities.tip + abs(quantities.tip))
        calmness = 1.0 / (1.0 + 4.0 * quantities.kinetic_energy)
        upright = upright * (0.5 + 0.5 * calmness)
        return upright * (1.0 - 0.1 * quantities.mean_squared_action)

    def failed(self, quantities: Quantities[Any]) -> Any:
        """Return whether the tip is below half the chain's length."""
        return quantities.tip < 0.5

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether the tip is at half the chain's length or above; lower ends the episode."""
        return quantities.tip >= 0.5


class Calm(Release):
    """Bring the released chain to rest.

    reward = (1 / (1 + e) + 1 / (1 + 100 e)) / 2 (1 - mean_squared_action / 10), with
    e = energy_fraction
    success: energy_fraction < 0.01
    """

    name = "calm"
    torque_share: ClassVar[float] = 0.2

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return a falling function of the energy, steep both at the start and near rest."""
        energy = quantities.energy_fraction
        calm = 0.5 / (1.0 + energy) + 0.5 / (1.0 + 100.0 * energy)
        return calm * (1.0 - 0.1 * quantities.mean_squared_action)

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether less than 1 % of the energy at the start is left."""
        return quantities.energy_fraction < 0.01


class Transition(NearPose):
    """From any equilibrium to any other; the rods of each hang or stand.

    reward = closeness^2 (1 + calmness) / 2 (1 - mean_squared_action / 10), with
    calmness = 1 / (1 + 4 kinetic_energy)
    success: for 5 s, goal_distance < 0.1 and kinetic_energy < 0.01

    Every rod is looked at, because one short rod that is upside down hardly changes the closeness.
    """

    name = "transition"
    hold: ClassVar[float] = 5.0
    has_goals = True
    pose: ClassVar[float] = 0.0
    spread: ClassVar[float] = 0.05  # deviations from the equilibrium that is drawn

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return the squared closeness to the goal, halved where fast."""
        calmness = 1.0 / (1.0 + 4.0 * quantities.kinetic_energy)
        near = quantities.closeness * quantities.closeness * (0.5 + 0.5 * calmness)
        return near * (1.0 - 0.1 * quantities.mean_squared_action)

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether every rod is near its goal, and the chain is slow."""
        return (quantities.goal_distance < 0.1) & (quantities.kinetic_energy < 0.01)


_BUILT_IN = (Passive, SwingUp, Balance, Calm, Transition)
_METHODS = {"start", "reward", "failed", "achieved"}
MODES: dict[str, type[Mode]] = {mode.name: mode for mode in _BUILT_IN}


def described_modes() -> Iterator[str]:
    """Yield the built-in modes as the lines of a list, for a docstring."""
    for name, mode in MODES.items():
        limit = f"max_torque {mode.torque_share:g} of the static torque by default"
        limit = limit if mode.torque_share > 0.0 else "no motor"
        text = cleandoc(mode.__doc__ or "")
        lines = f'"{name}", dt {mode.dt:g} s, {limit}: {text}'.splitlines()
        yield f"    - {lines[0]}"
        yield from (f"      {line}" if line else "" for line in lines[1:])


def find_mode(mode: object) -> Mode:
    """Return the mode itself, the built-in one of that name, or that of "package.module:Class"."""
    if isinstance(mode, Mode):
        if type(mode) in _BUILT_IN and (own := _METHODS & vars(mode).keys()):
            raise ValueError(
                "the methods of mode must be those of its class, because built-in modes are "
                f"compiled; got {min(own)} on an instance of {type(mode).__name__}: derive a class "
                "and override the method there"
            )
        return mode
    if isinstance(mode, str) and mode in MODES:
        return MODES[mode]()
    module, _, name = mode.partition(":") if isinstance(mode, str) else ("", "", "")
    if not (module and name):
        raise ValueError(
            f"mode must be one of {', '.join(MODES)}, an instance of npend_gym.envs.Mode "
            f'or the name of a class, "package.module:Class"; got {_checks.show(mode)}'
        )
    try:
        named: object = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"mode {_checks.show(mode)} cannot be imported: {error}") from error
    if not (isinstance(named, type) and issubclass(named, Mode)):
        raise TypeError(
            f"mode {_checks.show(mode)} must name a class derived from npend_gym.envs.Mode"
        )
    return named()
