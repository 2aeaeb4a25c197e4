"""One step of an environment as a function of state and action, with its derivatives."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import DifferentiableEnsemble

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
        self._ensembles: dict[int, DifferentiableEnsemble] = {}  # by the number of states

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
        ensemble, limit = self._ensemble(len(states)), self.config.max_torque
        ensemble.set_state(slice(None), *np.split(states, 2, axis=1))
        step = ensemble.step_jacobian(limit * actions, self.config.dt, self.config.substeps)
        return step.A, limit * step.B

    def diverges(self, states: FloatArray, actions: FloatArray) -> BoolArray:
        """Return which steps leave all bounds, (B,)."""
        self(states, actions)
        return self._ensemble(len(states)).diverged

    def _ensemble(self, count: int) -> DifferentiableEnsemble:
        if count not in self._ensembles:
            if len(self._ensembles) == _MAX_ENSEMBLES:
                self._ensembles.pop(next(iter(self._ensembles)))
            joints = self.config.joints.tolist()
            self._ensembles[count] = DifferentiableEnsemble(self.config.chain, count, joints=joints)
        return self._ensembles[count]
