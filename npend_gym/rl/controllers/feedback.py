"""Linear feedback of the state, which a regulator or a user designs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.controllers.step_model import (
    at_rest,
    check_config,
    checked_place,
    state_of,
    wrapped,
)


@dataclass(frozen=True, eq=False, repr=False)
class StateFeedback:
    """Linear feedback: the actions are -gain times the deviation from rest at `angle`.

    The deviation of the state (q, u) has the angles wrapped; a cart is to stand at `cart_position`.
    """

    config: EnvConfig
    angle: float | FloatArray  # rad, of all rods or of each, (n,)
    gain: FloatArray  # (joints, 2c)
    cart_position: float = 0.0  # m

    def __repr__(self) -> str:
        angle, gain = (np.array2string(np.asarray(each)) for each in (self.angle, self.gain))
        cart = f", cart_position={self.cart_position:g}" if self.config.has_cart else ""
        return f"StateFeedback({self.config.n} rods, angle={angle}, gain={gain}{cart})"

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions (B, joints), of discrete ones the numbers (B,); without B of one."""
        del observation
        return env_actions(self.config, self.actions(state_of(self.config, info)))

    @property
    def rest(self) -> FloatArray:
        """The state (q, u) that is held, (2c,)."""
        return at_rest(self.config, self.angle, self.cart_position)

    def actions(self, states: FloatArray) -> FloatArray:
        """Return the actions, (..., joints), in states (q, u), (..., 2c)."""
        return -self.deviation(states) @ self.gain.T

    def deviation(self, states: FloatArray) -> FloatArray:
        """Return the deviations of states (q, u), with the angles in [-pi, pi), (..., 2c)."""
        return wrapped(self.config, states - self.rest)


def state_feedback(
    config: EnvConfig,
    gain: ArrayLike,
    angle: float | FloatArray = np.pi,
    *,
    cart_position: float = 0.0,
) -> StateFeedback:
    """Return linear feedback with a gain of your own, such as one that another tool designed.

    Torques and force are -gain (x - x0). x is the state: the angles of the rods from the downward
    vertical [rad], the position of a cart [m], then the rates of all of these. x0 is rest at
    `angle`. Angles of x - x0 are in [-pi, pi). Limits of the motors clip the result.

    Parameters
    ----------
    config : EnvConfig
        Settings of the environment: ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``.
    gain : array_like, shape (joints, 2c), or (2c,) of one motor
        In N m, of a cart in N, for a unit of each entry of the state. It has a row for each entry
        of ``config.joints``: with a cart the force is first. So it fits B of
        ``linearise(config.chain, angle, joints=config.joints)``. The gain of `lqr` is of actions:
        ``lqr(config).gain * config.action_limits[:, None]`` is in these units.
    angle : float or ndarray, shape (n,)
        Goal of the rods [rad]: 0 for hanging, pi for upright, for all or for each.
    cart_position : float
        Goal of the cart [m].

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, the environment has no motor, or a motor no torque.

    See Also
    --------
    npend_gym.export.policy_of : the same as a `Policy`.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.linalg import solve_continuous_are
    >>> from npend_gym import physics, rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 1, "mode": "balance"}
    >>> config = EnvConfig(**task)
    >>> A, B = physics.linearise(config.chain, np.pi, joints=config.joints)
    >>> K = B.T @ solve_continuous_are(A, B, np.eye(2), np.eye(1))
    >>> rl.evaluate(rl.state_feedback(config, K), task, episodes=2).success.tolist()
    [True, True]
    """
    check_config(config)
    limits, shape = config.action_limits, (config.joints.size, config.state_size)
    if (limits <= 0.0).any():
        raise ValueError(
            "max_torque and max_force of the environment must be greater than zero for a feedback, "
            f"got limits of {limits.tolist()}"
        )
    given = _checks.array("gain", gain)
    if given.shape not in (shape, shape[1:] if shape[0] == 1 else shape):
        raise ValueError(
            f"gain must have the shape {shape}: a row for each of config.joints, "
            f"{config.joints.tolist()}, and a column for each of {state_names(config)}; got the "
            f"shape {given.shape}"
        )
    rest = _checks.within("angle", _checks.vector("angle", angle, config.n), 0.5 * MAX_ANGLE)
    place = checked_place(config, cart_position)
    return StateFeedback(config, rest, given.reshape(shape) / limits[:, None], place)


def state_names(config: EnvConfig) -> str:
    """Names of the entries of a state, in a few words."""
    cart = (", the cart's position", ", its velocity") if config.has_cart else ("", "")
    return f"{config.n} angles{cart[0]}, {config.n} angular velocities{cart[1]}"
