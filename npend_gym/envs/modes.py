"""What is asked of the chain: how an episode starts, what is rewarded, when it fails.

A mode is told physical quantities and knows neither Gymnasium nor the integrator. Its formulas
use only operations that give the same bits on every machine.
"""

from __future__ import annotations

from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from typing_extensions import NamedTuple  # that of Python 3.10 cannot be generic

from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain

_T = TypeVar("_T")


class Quantities(NamedTuple, Generic[_T]):
    """What a mode may judge by: numbers in a single environment, arrays (B,) in a vector one.

    Formulas of + - * /, abs and comparisons serve both. Energies are above hanging at rest, in
    units of what lifts the chain upright (without gravity: of what would on Earth), so that a
    reward means the same for every chain.
    """

    height: _T  # of the centre of mass: 0 hanging, 1 upright
    tip: _T  # height of the tip over the chain's length, -1 to 1
    energy: _T
    kinetic: _T
    left: _T  # energy over that at the start of the episode (where that is 0: energy)
    effort: _T  # mean square of the actions, 0 to 1
    theta: FloatArray  # unwrapped, rad; (n,) or (B, n)
    omega: FloatArray  # rad/s; (n,) or (B, n)


def lifting_energy(chain: Chain) -> float:
    """Return the unit of energy of `Quantities` [J]: 2 g sum_i l_i sum_{k>=i} m_k."""
    gravity = chain.gravity if chain.gravity > 0.0 else STANDARD_GRAVITY
    return 2.0 * gravity * float(chain.lengths @ chain.carried_masses)


class Mode:
    """The base of all modes; derive from it and pass an instance as ``mode=`` for one of your own.

    Attributes
    ----------
    name : str
    dt : float
        Default time of a step [s].
    torque_share : float
        Default torque limit over the torque that holds the whole chain horizontal,
        g sum_i l_i sum_{k>=i} m_k. Zero: the mode has no actuator.
    hold : float
        For how long [s] the goal must have been met without a break to count as success.
    """

    name: ClassVar[str] = "custom"
    dt: ClassVar[float] = 0.05
    torque_share: ClassVar[float] = 0.5
    hold: ClassVar[float] = 0.0

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Draw the starting angles [rad] and angular velocities [rad/s], each of shape (n,)."""
        raise NotImplementedError

    def reward(self, seen: Quantities[Any]) -> Any:
        """Return the reward of the step, between 0 and 1."""
        raise NotImplementedError

    def failed(self, seen: Quantities[Any]) -> Any:
        """Return whether the episode has failed and so terminates; never by default."""
        return seen.tip < -2.0

    def achieved(self, seen: Quantities[Any]) -> Any:
        """Return whether the goal is met at this instant; by default: the episode has not failed.

        ``info["success"]`` says that it has been so for the last `hold` seconds.
        """
        return np.logical_not(self.failed(seen))


def _calmness(seen: Quantities[Any]) -> Any:
    """Return 1 at rest, 1/2 where the kinetic energy is a quarter of the unit."""
    return 1.0 / (1.0 + 4.0 * seen.kinetic)


def _release(
    rng: np.random.Generator, n: int, amplitude: float, spread: float
) -> tuple[FloatArray, FloatArray]:
    """Start at rest with all rods at `amplitude` plus one draw from [0, spread) common to all."""
    return np.full(n, amplitude + spread * rng.random()), np.zeros(n)


class Passive(Mode):
    """The paper's experiment: a free release from rest; no torque, no reward, no failure."""

    name = "passive"
    dt = 0.01
    torque_share = 0.0

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start the free release."""
        return _release(rng, n, amplitude, spread)

    def reward(self, seen: Quantities[Any]) -> Any:
        """Return 0."""
        return 0.0 * seen.tip

    def achieved(self, seen: Quantities[Any]) -> Any:
        """Return False: there is nothing to achieve."""
        return seen.tip > 2.0


class SwingUp(Mode):
    """From hanging nearly at rest to upright and slow.

    reward = height^2 (1 + calmness) / 2 (1 - effort / 10), with calmness = 1 / (1 + 4 kinetic)
    success: for 5 s, height > 0.95 and kinetic < 0.01
    """

    name = "swingup"
    hold = 5.0

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start within 0.05 rad and 0.05 rad/s of hanging at rest."""
        del amplitude, spread
        return rng.uniform(-0.05, 0.05, n), rng.uniform(-0.05, 0.05, n)

    def reward(self, seen: Quantities[Any]) -> Any:
        """Return the squared height of the centre of mass, halved where fast."""
        upright = seen.height * seen.height * (0.5 + 0.5 * _calmness(seen))
        return upright * (1.0 - 0.1 * seen.effort)

    def achieved(self, seen: Quantities[Any]) -> Any:
        """Return where the chain is upright and slow."""
        return (seen.height > 0.95) & (seen.kinetic < 0.01)


class Balance(Mode):
    """Keep the upright chain up; fails when the tip falls below half its full height.

    reward = max(tip, 0) (1 + calmness) / 2 (1 - effort / 10)
    success: not failed
    """

    name = "balance"
    dt = 0.02

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start within 0.02 rad and 0.02 rad/s of standing upright."""
        del amplitude, spread
        return np.pi + rng.uniform(-0.02, 0.02, n), rng.uniform(-0.02, 0.02, n)

    def reward(self, seen: Quantities[Any]) -> Any:
        """Return the height of the tip, halved where fast."""
        upright = 0.5 * (seen.tip + abs(seen.tip))
        upright = upright * (0.5 + 0.5 * _calmness(seen))
        return upright * (1.0 - 0.1 * seen.effort)

    def failed(self, seen: Quantities[Any]) -> Any:
        """Return where the tip is below half the chain's length."""
        return seen.tip < 0.5

    def achieved(self, seen: Quantities[Any]) -> Any:
        """Return where the tip is at half the chain's length or above; lower ends the episode."""
        return seen.tip >= 0.5


class Calm(Mode):
    """Bring the released chain to rest.

    reward = (1 / (1 + left) + 1 / (1 + 100 left)) / 2 (1 - effort / 10), with `left` the energy
    over that at the start
    success: left < 0.01
    """

    name = "calm"
    torque_share = 0.2

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start the free release."""
        return _release(rng, n, amplitude, spread)

    def reward(self, seen: Quantities[Any]) -> Any:
        """Return a falling function of the energy left, steep both at the start and near rest."""
        calm = 0.5 / (1.0 + seen.left) + 0.5 / (1.0 + 100.0 * seen.left)
        return calm * (1.0 - 0.1 * seen.effort)

    def achieved(self, seen: Quantities[Any]) -> Any:
        """Return where less than 1 % of the energy at the start is left."""
        return seen.left < 0.01


MODES: dict[str, type[Mode]] = {mode.name: mode for mode in (Passive, SwingUp, Balance, Calm)}
