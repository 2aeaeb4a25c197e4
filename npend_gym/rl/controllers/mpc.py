"""Model predictive control: in every step the actions over a horizon are planned again by iLQR."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.controllers.ilqr import ILQR, Cost, Motions, concatenated
from npend_gym.rl.controllers.regulators import riccati
from npend_gym.rl.controllers.step_model import (
    at_rest,
    beyond,
    check_config,
    checked_place,
    state_of,
    wrapped,
)
from npend_gym.rl.evaluation.settings import number_of_steps
from npend_gym.theory import fundamental_period

_GUESS = 0.3  # standard deviation of the actions from which the first plan begins


class MPC:
    """Model predictive control by iLQR: it knows the equations of motion, and needs no training.

    In every step it plans the motion over the horizon, beginning with the plan of the step before.
    It takes the first actions of the plan. So it swings up, balances, and recovers from pushes that
    `lqr` does not survive. Environments are independent of each other. If the time of one is not a
    step later than in the previous call, its episode is new. It is then planned from the start.

    Parameters
    ----------
    config : EnvConfig
        Settings of the environment, ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``. The
        plan has the steps of the environment, with ideal motors and sensors. In the plan, dry
        friction fades below the speed of a swing of 0.03 rad. Feedback for friction at rest would
        fail once noise moves a joint.
    angle : float or array_like, shape (n,)
        Angles at which the rods should rest [rad]; by default all upright.
    horizon : float, optional
        How far it looks ahead [s]; by default for one period of the chain's slowest normal mode.
    iterations : int
        Iterations of iLQR in a step.
    first_iterations : int
        Iterations in the first step of an episode.
    action_weight, last_weight : float
        The cost of a state is the sum over the rods of 2 - 2 cos(theta - angle) + (l / g) omega^2,
        where l is the mean length of the rods; of an action `action_weight` times its square. A
        cart adds the same cost as in `lqr`, and much more near the ends of its rail. The cost of
        the last state is multiplied by `last_weight`.
    seed : int
        Seed of the actions from which the first plan begins.
    cart_position : float
        Position at which a cart should stand [m].

    Attributes
    ----------
    plans : Motions
        The plans of the last call: `states`, (steps + 1, B, 2c), and `actions`, (steps, B, joints).

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, or the environment has no motor.
    FloatingPointError
        When it is called, if a motion over the horizon leaves all bounds: its steps are too coarse.

    Notes
    -----
    The method is from Y. Tassa, N. Mansard, E. Todorov, "Control-limited differential dynamic
    programming", ICRA 2014. Improving the plan once in every step is from Y. Tassa, T. Erez, E.
    Todorov, "Synthesis and stabilization of complex behaviors through online trajectory
    optimization", IROS 2012.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import MPC, evaluate
    >>> keywords = {"mode": "swingup", "n": 1}
    >>> evaluate(MPC(EnvConfig(**keywords)), keywords, episodes=2).success_rate
    1.0
    """

    def __init__(
        self,
        config: EnvConfig,
        angle: ArrayLike = np.pi,
        *,
        horizon: float | None = None,
        iterations: int = 1,
        first_iterations: int = 30,
        action_weight: float = 0.1,
        last_weight: float = 10.0,
        seed: int = 0,
        cart_position: float = 0.0,
    ) -> None:
        check_config(config)
        self.iterations: int = _checks.count("iterations", iterations)
        self.first_iterations: int = _checks.count("first_iterations", first_iterations)
        self._config = config
        ahead = fundamental_period(config.chain.hung()) if horizon is None else horizon
        if horizon is None and np.isnan(ahead):
            raise ValueError("horizon must be given for a chain without a period")
        steps = number_of_steps("horizon", ahead, config.dt)
        goal = _checks.within("angle", _checks.vector("angle", angle, config.n), 0.5 * MAX_ANGLE)
        weight = _checks.positive_number("action_weight", action_weight)
        last = _checks.positive_number("last_weight", last_weight)
        self._goal = at_rest(config, goal, checked_place(config, cart_position))
        self._ilqr = ILQR(Cost(config, self._goal, weight, last))
        self._gain = np.zeros((config.joints.size, config.state_size))
        with suppress(np.linalg.LinAlgError):  # no feedback stabilises this goal
            self._gain = riccati(config, goal, weight).gain
        rng = np.random.default_rng(_checks.count("seed", seed, low=0))
        self._guess = rng.normal(0.0, _GUESS, (steps, config.joints.size)).clip(-1.0, 1.0)
        self.plans = Motions(*np.empty((5, 0)))  # of the last call
        self.reset()

    def reset(self, num_envs: int = 0) -> None:
        """Forget all plans; `num_envs` has no effect."""
        del num_envs
        self._lanes, self._time = np.zeros(0, np.int64), np.zeros(0)  # that have plans, and when

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions (B, joints), of discrete ones the numbers (B,); without B of one."""
        del observation
        states = state_of(self._config, info)
        actions = self.plan(np.atleast_2d(states), np.atleast_1d(info["time"]))
        return env_actions(self._config, actions if states.ndim == 2 else actions[0])

    def plan(
        self, states: FloatArray, time: FloatArray, which: NDArray[np.int64] | None = None
    ) -> FloatArray:
        """Return the actions, (B, joints), in states (q, u), (B, 2c), at times [s], (B,).

        `which` has the numbers of the environments, ascending, by default those from 0 on. Plans of
        others are forgotten.
        """
        which = np.arange(len(states)) if which is None else which
        _, now, before = np.intersect1d(which, self._lanes, True, return_indices=True)
        dt = self._config.dt
        on_time = abs(time[now] - self._time[before] - dt) < 0.5 * dt
        known, new = now[on_time], np.delete(np.arange(len(which)), now[on_time])
        parts: list[Motions] = []
        if known.size > 0:
            motions = self._ilqr.follow(states[known], self.plans.of(before[on_time]).shifted())
            motions = self._improved(motions, self.iterations)
            parts.append(self._on_rail(states[known], motions, which[known]))
        if new.size > 0:
            parts.append(self._first_plan(states[new], which[new]))
        self.plans: Motions = concatenated(parts).of(np.argsort([*known, *new]))
        self._lanes, self._time = which, time.copy()
        return self.plans.actions[0]

    def _first_plan(self, states: FloatArray, lanes: NDArray[np.int64]) -> Motions:
        """Return the better plan of two: one begins with random actions, the other with `lqr`."""
        del lanes
        away = states - self._goal
        about = self._goal + away - wrapped(self._config, away)
        about[:, self._config.n :] = self._goal[self._config.n :]
        guesses = (self._guess, 0.0 * self._gain), (0.0 * self._guess, self._gain)
        begun = [self._ilqr.begin(states, actions, about, k) for actions, k in guesses]
        return _cheapest(self._improved(concatenated(begun), self.first_iterations), len(states))

    def _on_rail(self, states: FloatArray, plans: Motions, lanes: NDArray[np.int64]) -> Motions:
        """Return the plans; plans that leave the rail are made again where that is cheaper."""
        off = np.any(beyond(self._config, plans.states, 1.0) != 0.0, axis=0)
        if not off.any():
            return plans
        again = concatenated([plans.of(off), self._first_plan(states[off], lanes[off])])
        order = np.concatenate([np.flatnonzero(~off), np.flatnonzero(off)])
        best = _cheapest(again, int(off.sum()))
        return concatenated([plans.of(~off), best]).of(np.argsort(order))

    def _improved(self, motions: Motions, iterations: int) -> Motions:
        for _ in range(iterations):
            motions = self._ilqr.improve(motions)
        return motions


def _cheapest(plans: Motions, lanes: int) -> Motions:
    """Return the cheapest plan of each lane, of as many plans for all lanes one after the other."""
    return plans.of(plans.cost.reshape(-1, lanes).argmin(axis=0) * lanes + np.arange(lanes))
