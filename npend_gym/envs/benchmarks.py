"""Tasks of other packages, with the dynamics of this one: see docs/tasks."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from npend_gym.envs.modes import NearPose, Quantities

_LN_10, _TURN = 2.302585092994046, 2.0 * math.pi
_MOST, _SQUARINGS, _TERMS = 40.0, 6, 16  # exp(-40) is below half the spacing of floats at 1


def _decay(x: Any) -> Any:
    """Return exp(-x) of x >= 0, by a series with the same bits everywhere and a gradient."""
    r, grown = 0.5**_SQUARINGS * (0.5 * ((x + _MOST) - abs(x - _MOST))), 1.0  # at most _MOST
    for k in range(_TERMS, 0, -1):
        grown = 1.0 + r * grown * (1.0 / k)
    for _ in range(_SQUARINGS):
        grown = grown * grown
    return 1.0 / grown


class DMAcrobot(NearPose):
    """The acrobot of dm_control: from any angles, at rest, to the tip at the top.

    reward = 10^(-d^2), with d = max(2 tip_distance - 0.2, 0): 1 within 0.2 m of the target
    success: tip_distance <= 0.1
    """

    name = "dm_acrobot"
    dt: ClassVar[float] = 0.01
    pose: ClassVar[float] = 0.0
    spread: ClassVar[float] = math.pi
    other_spread: ClassVar[float] = 0.0

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return 1 where the tip is in the target; it falls to 0.1 at 1 m from its surface."""
        beyond = 2.0 * quantities.tip_distance - 0.2
        distance = 0.5 * (beyond + abs(beyond))
        return _decay(_LN_10 * (distance * distance))

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether the tip is in the target."""
        return quantities.tip_distance <= 0.1


class PufferDoublePendulum(NearPose):
    """The double pendulum of PufferLib: two poles on a cart swing up and stay upright.

    reward = (h c f + exp(-mean(phi^2) / 0.09 - mean(omega^2) - (x / 2)^2)) / 2, with the height
    h = (1 + tip) / 2, c = (1 + 10^-(x / 2)^2) / 2 (1 - mean_squared_action / 5),
    f = (3 + 2 * 10^-max(omega^2 / 25)) / 5, angles phi from the upright [rad], and the cart at x
    [m] on a rail of 5 m
    success: height > 0.9, abs(omega) < 1.5 rad/s, and the cart slower than 1 m/s
    """

    name = "puffer_double_pendulum"
    dt: ClassVar[float] = 0.02
    pose: ClassVar[float] = 0.0
    spread: ClassVar[float] = 0.08
    other_spread: ClassVar[float] = 0.5
    rail_weight: ClassVar[float] = 0.0

    def reward(self, quantities: Quantities[Any]) -> Any:
        """Return the mean of a height that counts where all is slow, and of a nearness to rest."""
        fastest, away = 0.0, 0.0
        for speed, angle in zip(_speeds(quantities), _columns(quantities.theta), strict=True):
            fastest = 0.5 * (fastest + speed + abs(fastest - speed))
            tilt = angle % _TURN - math.pi
            away = away + (tilt * tilt / 0.09 + speed * speed)
        place = 2.5 * quantities.rail_position
        centred = 0.5 + 0.5 * _decay(_LN_10 * (place * place))
        slow = 0.6 + 0.4 * _decay(_LN_10 / 25.0 * (fastest * fastest))
        cheap = 1.0 - 0.2 * quantities.mean_squared_action
        high = (0.5 + 0.5 * quantities.tip) * centred * slow * cheap
        mean = 1.0 / len(_columns(quantities.theta))
        return 0.5 * (high + _decay(mean * away + place * place))

    def achieved(self, quantities: Quantities[Any]) -> Any:
        """Return whether the poles are upright, and they and the cart slow."""
        holds = (quantities.tip > 0.8) & (abs(quantities.cart_velocity) < 1.0)
        for speed in _speeds(quantities):
            holds = holds & (speed < 1.5)
        return holds


def _columns(values: Any) -> list[Any]:
    """Return the values of each rod, of an array or tensor (..., n)."""
    return [values[..., i] for i in range(values.shape[-1])]


def _speeds(quantities: Quantities[Any]) -> list[Any]:
    return [abs(column) for column in _columns(quantities.omega)]


def steps_held(successes: ArrayLike) -> int:
    """Return the longest run of steps with success in an episode: PufferLib's `hold_time`.

    Parameters
    ----------
    successes : array_like, shape (steps,)
        ``info["success"]`` after each step.
    """
    run = longest = 0
    for success in np.asarray(successes, np.bool_):
        run = run + 1 if success else 0
        longest = max(longest, run)
    return longest
