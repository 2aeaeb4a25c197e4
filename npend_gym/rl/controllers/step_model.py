"""One step of an environment as a function of state and action, with its derivatives.

The state of a mechanism is (q, u): the angles of the rods, then the place of a cart, and the rates
of all of these in the same order. c is the number of coordinates q.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.envs import EnvConfig
from npend_gym.physics import DifferentiableEnsemble, Ensemble
from npend_gym.rl.angles import wrap

_MAX_ENSEMBLES = 16


def check_config(config: Any) -> None:
    """Raise an error if a user gives something else than settings, or there is no motor."""
    if not isinstance(config, EnvConfig):
        raise TypeError(
            "config must be the settings of an environment, env.unwrapped.config or "
            f"EnvConfig(...); got {_checks.show(config)}"
        )
    if config.joints.size == 0:
        raise ValueError(f'the environment must have motors, got mode "{config.mode.name}"')


def state_of(config: EnvConfig, info: Mapping[str, Any]) -> FloatArray:
    """Return the states (q, u) that `info` tells, (B, 2c); of a single environment (2c,)."""
    shape, on_cart = np.shape(info["theta"]), "cart_position" in info
    if len(shape) not in (1, 2) or shape[-1] != config.n:
        raise ValueError(
            f'info["theta"] must have the shape (B, {config.n}), or ({config.n},) in a single '
            f"environment, got {shape}"
        )
    if on_cart != config.has_cart:
        raise ValueError(
            f'info must {"" if config.has_cart else "not "}have "cart_position" and '
            f'"cart_velocity": the controller was made for base="{config.base}"'
        )
    shapes = {"theta": shape, "omega": shape}
    if on_cart:
        shapes |= {"cart_position": shape[:-1], "cart_velocity": shape[:-1]}
    values = [np.asarray(info[name], np.float64) for name in shapes]
    for (name, wanted), value in zip(shapes.items(), values, strict=True):
        if value.shape != wanted:
            raise ValueError(f'info["{name}"] must have the shape {wanted}, got {value.shape}')
    return joined(values[0], values[1], values[2:])


def joined(theta: FloatArray, omega: FloatArray, cart: Iterable[FloatArray]) -> FloatArray:
    """Return states (q, u), (..., 2c); of a cart, where there is one, `cart` has place and rate."""
    of_cart = [each[..., None] for each in cart]
    return np.concatenate([theta, *of_cart[:1], omega, *of_cart[1:]], axis=-1)


def at_rest(config: EnvConfig, angle: float | FloatArray, place: float = 0.0) -> FloatArray:
    """Return the state (q, u), (2c,), at rest at `angle`, a cart at `place` [m] on its rail."""
    state = np.zeros(config.state_size)
    state[: config.n] = angle
    if config.has_cart:
        state[config.n] = place
    return state


def checked_place(config: EnvConfig, place: Any, share: float = 1.0) -> float:
    """Return the place that a user gives a cart [m], within a share of its rail."""
    place = _checks.number("cart_position", place)
    if config.rail is None and place != 0.0:
        raise ValueError(
            f"cart_position must be left out without a cart, got {place:g}; an environment with "
            'base="cart" has one'
        )
    if config.rail is not None and abs(place) > share * config.rail:
        raise ValueError(
            f"cart_position must lie within +-{share * config.rail:g} m, {share:.3g} of the rail, "
            f"got {place:g}; the environment's rail=... makes it longer"
        )
    return place


def wrapped(config: EnvConfig, deviation: FloatArray) -> FloatArray:
    """Return deviations of states, (..., 2c), with the angles in [-pi, pi)."""
    short = deviation.copy()
    short[..., : config.n] = wrap(short[..., : config.n])
    return short


def beyond(config: EnvConfig, states: FloatArray, share: float) -> FloatArray:
    """Return how far carts are beyond a share of the rail [m], (...); 0 without a cart."""
    if config.rail is None:
        return np.zeros(states.shape[:-1])
    place, free = states[..., config.n], share * config.rail
    return place - np.clip(place, -free, free)


def of_actions(
    config: EnvConfig, loads: FloatArray, limits: FloatArray | None = None
) -> FloatArray:
    """Return the derivatives by the actions, from those by the torques of `motors`, then the force.

    Both have a column for each input. `limits`, (B, joints), are those of the environments where
    they differ.
    """
    places = [*motors(config), config.n]
    by = config.action_limits if limits is None else limits[:, None]
    return loads[..., [places.index(joint) for joint in config.joints]] * by


def motors(config: EnvConfig) -> list[int]:
    """Return the joints with a motor, in the order of the actions; the cart is none."""
    return [joint for joint in config.joints.tolist() if joint < config.n]


def loads_of(
    config: EnvConfig, actions: FloatArray, limits: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the torques of the motors, (B, motors), and the force on the cart, (B,)."""
    loads = actions * (config.action_limits if limits is None else limits)
    on_joint = config.joints < config.n
    return loads[:, on_joint], loads[:, ~on_joint].sum(axis=1)


def set_states(config: EnvConfig, ensemble: Ensemble, lanes: Any, states: FloatArray) -> None:
    """Put some sub-environments of an ensemble into states (q, u), (lanes, 2c)."""
    (q, u), n = np.split(states, 2, axis=1), config.n
    cart = (q[:, n], u[:, n]) if config.has_cart else (0.0, 0.0)
    ensemble.set_state(lanes, q[:, :n], u[:, :n], cart=cart)


def states_of(config: EnvConfig, ensemble: Ensemble) -> FloatArray:
    """Return the states (q, u) of an ensemble, (B, 2c)."""
    return joined(ensemble.theta, ensemble.omega, ensemble.cart if config.has_cart else ())


class StepModel:
    """Steps of the environment from any states (q, u), all side by side.

    Actions are torques and forces divided by their limits. `chain` moves in place of that of the
    environment.
    """

    def __init__(self, config: EnvConfig, chain: Chain | None = None) -> None:
        self.config = config
        self.chain: Chain = config.chain if chain is None else chain
        self._ensembles: dict[int, DifferentiableEnsemble] = {}  # by the number of states

    def __call__(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2c), after a step from `states` under `actions`, (B, joints)."""
        self._begin(states)
        return self.advance(actions)

    def advance(self, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2c), after one more step, where the last call took as many."""
        ensemble, (torque, force) = self._ensemble(len(actions)), loads_of(self.config, actions)
        ensemble.advance(torque, self.config.dt, self.config.substeps, force=force)
        return states_of(self.config, ensemble)

    def derivatives(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the steps from `states`, (B, 2c), under `actions`.

        By state, (B, 2c, 2c), and by action, (B, 2c, joints).
        """
        return self.linearised(states, actions)[1:]

    def linearised(
        self, states: FloatArray, actions: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the states, (B, 2c), after a step from `states`, and its `derivatives`."""
        ensemble, (torque, force) = self._begin(states), loads_of(self.config, actions)
        step = ensemble.step_jacobian(torque, self.config.dt, self.config.substeps, force=force)
        reached = np.concatenate([step.theta, step.omega], axis=1)
        return reached, step.A, of_actions(self.config, step.B)

    def diverges(self, states: FloatArray, actions: FloatArray) -> BoolArray:
        """Return which steps leave all bounds, (B,)."""
        self(states, actions)
        return self._ensemble(len(states)).diverged

    def _begin(self, states: FloatArray) -> DifferentiableEnsemble:
        """Return the ensemble in these states, one sub-environment for each."""
        ensemble = self._ensemble(len(states))
        set_states(self.config, ensemble, slice(None), states)
        return ensemble

    def _ensemble(self, count: int) -> DifferentiableEnsemble:
        if count not in self._ensembles:
            if len(self._ensembles) == _MAX_ENSEMBLES:
                self._ensembles.pop(next(iter(self._ensembles)))
            joints = motors(self.config)
            self._ensembles[count] = DifferentiableEnsemble(self.chain, count, joints=joints)
        return self._ensembles[count]
