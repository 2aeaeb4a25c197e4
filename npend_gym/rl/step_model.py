"""One step of an environment as a function of state and action, with its derivatives."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble

_DIFFERENCE = 1e-5  # for derivatives by central differences
_MAX_ENSEMBLES = 16


def check_base(config: EnvConfig) -> EnvConfig:
    """Return `config`, refused where a cart carries the pivot."""
    if config.has_cart:
        raise ValueError('base must be "pivot" for controllers of joints, got "cart"')
    return config


class StepModel:
    """Steps of the environment from any states, all side by side.

    States are (theta, omega) [rad, rad/s]; actions are torques divided by their limit.
    """

    def __init__(self, config: EnvConfig) -> None:
        self.config = check_base(config)
        self._ensembles: dict[int, Ensemble] = {}  # by the number of states

    def __call__(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2n), after a step from `states` under `actions`, (B, joints)."""
        self._ensemble(len(states)).set_state(slice(None), *np.split(states, 2, axis=1))
        return self.advance(actions)

    def advance(self, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2n), after one more step, where the last call took as many."""
        ensemble, config = self._ensemble(len(actions)), self.config
        ensemble.advance(config.max_torque * actions, config.dt, config.substeps)
        return np.hstack([ensemble.theta, ensemble.omega])

    def derivatives(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the steps from `states`, (B, 2n), under `actions`.

        By state, (B, 2n, 2n), and by action, (B, 2n, joints).
        """
        at, size = np.hstack([states, actions]), states.shape[1]
        difference = _DIFFERENCE * np.eye(at.shape[1])
        places = at[:, None, None] + np.stack([difference, -difference], axis=1)
        flat = places.reshape(-1, at.shape[1])
        reached = self(flat[:, :size], flat[:, size:]).reshape(*places.shape[:3], size)
        slopes = np.swapaxes(reached[:, :, 0] - reached[:, :, 1], 1, 2) / (2.0 * _DIFFERENCE)
        return slopes[..., :size], slopes[..., size:]

    def _ensemble(self, count: int) -> Ensemble:
        if count not in self._ensembles:
            if len(self._ensembles) == _MAX_ENSEMBLES:
                self._ensembles.pop(next(iter(self._ensembles)))
            joints = self.config.joints.tolist()
            self._ensembles[count] = Ensemble(self.config.chain, count, joints=joints)
        return self._ensembles[count]
