"""Swing-up by energy shaping: pump energy into the chain, then balance by LQR."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.physics.energy import total_energy
from npend_gym.rl.controllers.regulators import StateFeedback, riccati, time_scale, turned_by
from npend_gym.rl.controllers.step_model import check_config, checked_place, state_of

_CENTRE = 0.6  # of the force limit, for a cart one mean length of the rods away
_STILL = 1e-3  # angular velocity times time_scale below which no rod shows where to pump


@dataclass(frozen=True, eq=False)
class EnergySwingUp:
    """Swing-up by energy shaping: pump energy into the chain, then balance by LQR near upright.

    While energy is missing the motors drive the chain on, and brake it where there is too much:
    action = pump_gain (1 - energy / upright_energy) time_scale times the rate at which the joint
    turns. Where all rods are still, actions are full, in the direction in which gravity moves the
    chain next; so the chain leaves any rest. A force on a cart drives the chain by its momentum p
    relative to the cart: the rate is -p / (m l) there. What centres the cart is added:
    `_CENTRE` (position + time_scale velocity) / l. The energy of a cart and its chain leaves out
    the motion of their centre of mass along the rail, which only a force changes. The regulator
    takes over where its cost of the state is below `catch_cost`.
    """

    balance: StateFeedback
    cost: FloatArray  # S of `riccati`, (2c, 2c)
    pump_gain: float
    catch_cost: float

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions (B, joints), of discrete ones the numbers (B,); without B of one."""
        del observation
        config = self.balance.config
        chain, n, states = config.chain.hung(), config.n, state_of(config, info)
        q, u = np.split(states, 2, axis=-1)
        theta, omega, scale = q[..., :n], u[..., :n], time_scale(config)
        has, (rates, momentum) = total_energy(chain, theta, omega), self._driven(theta, u)
        if config.cart_mass is not None:
            has = has - 0.5 * momentum**2 / (float(chain.masses.sum()) + config.cart_mass)
        missing = 1.0 - has[..., None] / chain.lifting_energy
        pump = (self.pump_gain * missing * rates * scale).clip(-1.0, 1.0)
        # where nothing moves, nothing would ever be pumped
        falling = np.zeros_like(u)
        falling[..., :n] = -np.sin(theta)
        begin = np.sign(missing) * np.where(self._driven(theta, falling)[0] < 0.0, -1.0, 1.0)
        still = np.all(np.abs(omega) * scale < _STILL, axis=-1)
        pump = np.where(still[..., None], begin, pump)
        if config.has_cart:
            away = q[..., n] - self.balance.cart_position + scale * u[..., n]
            pump[..., config.joints == n] -= _CENTRE * away[..., None] / chain.lengths.mean()
        x = self.balance.deviation(states)
        near = np.sum(x @ self.cost * x, axis=-1) < self.catch_cost
        actions = np.where(near[..., None], self.balance.actions(states), pump)
        return env_actions(config, actions)

    def _driven(self, theta: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the rates at which the motors drive the chain on, (..., joints), and p, (...)."""
        config, chain = self.balance.config, self.balance.config.chain
        rates = u @ turned_by(config).T
        momentum = np.sum(chain.lift * np.cos(theta) * u[..., : config.n], axis=-1)
        size = float(chain.masses.sum()) * float(chain.lengths.mean())
        rates[..., config.joints == config.n] = -momentum[..., None] / size
        return rates, momentum


def energy_swing_up(
    config: EnvConfig,
    pump_gain: float = 30.0,
    catch_cost: float = 15.0,
    *,
    cart_position: float = 0.0,
) -> EnergySwingUp:
    """Return a swing-up by energy shaping followed by `lqr`, for a motor at the base or a cart.

    The defaults did best for n = 2 among gains of 3 to 100 and costs of 5 to 50, in the 200
    episodes of the seeds 0 to 199. A cart should stand at `cart_position` [m].

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, or no motor is at the base or a cart.
    numpy.linalg.LinAlgError
        If the motors cannot stabilise the upright chain.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 1, "mode": "swingup"}
    >>> rl.evaluate(rl.energy_swing_up(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    check_config(config)
    if not {0, config.n} & set(config.joints.tolist()):
        raise ValueError(
            f"actuated must have the first joint or a cart, got {config.joints.tolist()}: motors "
            "elsewhere do not pump energy in"
        )
    pump_gain = _checks.positive_number("pump_gain", pump_gain)
    catch_cost = _checks.nonnegative_number("catch_cost", catch_cost)
    gain, cost, _ = riccati(config, np.pi, action_weight=1.0)
    balance = StateFeedback(config, np.pi, gain, checked_place(config, cart_position))
    return EnergySwingUp(balance, cost, pump_gain, catch_cost)
