"""Iterative LQR: actions over a horizon that cost least, with bounds, for many states side by side.

The method is that of Tassa, Mansard, Todorov, "Control-limited differential dynamic programming",
ICRA 2014, without the second derivatives of the dynamics: steps are linearised along a motion, and
a Riccati recursion backwards gives a change of the actions and feedback gains. The best of some
step lengths is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.regulators import softened, state_weights
from npend_gym.rl.controllers.step_model import StepModel, beyond

_STEP_LENGTHS = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
_SWEEPS = 20  # over the actions, to find those at their bounds
_DAMPING = 1e-3  # at first
_DAMPING_RANGE = 1e-6, 1e6
_FREE, _WALL = 0.8, 2e4  # of the rail; where upright rods save 4 each


class Cost(NamedTuple):
    """What a motion costs: the sum over its steps, and `last` times that of its last state.

    The cost of a state is near that of `lqr` about the goal, with 2 - 2 cos(theta - angle) in place
    of the square of an angle: a rod may have turned any number of times. Near the end of its rail a
    cart costs `_WALL` times a square. It is that of the distance beyond `_FREE` of the rail, over
    the rail.
    """

    config: EnvConfig
    goal: FloatArray  # (2c,): the state (q, u)
    action_weight: float
    last: float

    def total(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Return the costs (...) of states (steps + 1, ..., 2c), actions (steps, ..., joints)."""
        n, weights = self.config.n, np.diag(state_weights(self.config))
        deviation = states - self.goal
        of_states = np.sum(2.0 - 2.0 * np.cos(deviation[..., :n]), axis=-1)
        of_states = of_states + np.sum(weights[n:] * deviation[..., n:] ** 2, axis=-1)
        if self.config.rail is not None:
            far = beyond(self.config, states, _FREE) / self.config.rail
            of_states = of_states + _WALL * far**2
        of_actions = self.action_weight * np.sum(actions**2, axis=(0, -1))
        return np.sum(of_states[:-1], axis=0) + self.last * of_states[-1] + of_actions

    def slopes(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient and second derivatives, a diagonal, of the costs by each state.

        With sin^2 and cos^2 of half the angle the costs are sums of squares; what is returned is
        their Gauss-Newton approximation, which is never negative.
        """
        n, deviation, weight = self.config.n, states - self.goal, np.ones((len(states), 1, 1))
        weight[-1] = self.last
        weights = 2.0 * np.diag(state_weights(self.config))
        first, second = weights * deviation, np.full_like(states, weights)
        first[..., :n] = 2.0 * np.sin(deviation[..., :n])
        second[..., :n] = 1.0 + np.cos(deviation[..., :n])
        if self.config.rail is not None:
            far, wall = beyond(self.config, states, _FREE), 2.0 * _WALL / self.config.rail**2
            first[..., n] += wall * far
            second[..., n] += wall * (far != 0.0)
        return weight * first, weight * second


class Motions(NamedTuple):
    """Motions of B chains over a horizon, with feedback about them."""

    states: FloatArray  # (steps + 1, B, 2c)
    actions: FloatArray  # (steps, B, joints)
    gains: FloatArray  # (steps, B, joints, 2c): actions are added -gains times the deviation
    cost: FloatArray  # (B,)
    damping: FloatArray  # (B,), added to the second derivatives by the actions

    def of(self, lanes: NDArray[Any]) -> Motions:
        """Return the motions of some chains, given as numbers or as a mask."""
        return Motions(*(each[lanes] if each.ndim == 1 else each[:, lanes] for each in self))

    def shifted(self) -> Motions:
        """Return the motions from the second state on, with a last step without action."""
        states, actions, gains = (np.roll(each, -1, axis=0) for each in self[:3])
        states[-1], actions[-1], gains[-1] = self.states[-1], 0.0, 0.0
        return self._replace(states=states, actions=actions, gains=gains)


def concatenated(parts: Sequence[Motions]) -> Motions:
    """Return the motions of all parts as one."""
    fields = zip(*parts, strict=True)
    return Motions(*(np.concatenate(each, axis=min(1, each[0].ndim - 1)) for each in fields))


class ILQR:
    """Motions over a horizon that are improved step by step.

    Dry friction is that of `softened`, in motions and derivatives alike, so that these agree.
    """

    def __init__(self, cost: Cost) -> None:
        self.model: StepModel = StepModel(cost.config, softened(cost.config))
        self.cost: Cost = cost

    def begin(
        self, start: FloatArray, actions: FloatArray, about: FloatArray, gain: FloatArray
    ) -> Motions:
        """Return the motions from `start`, (B, 2c), under `actions`, (steps, joints).

        With the feedback `gain`, (joints, 2c), about the states `about`, (B, 2c).
        """
        steps, lanes = len(actions), len(start)
        states = np.broadcast_to(about, (steps + 1, *about.shape))
        everywhere = np.repeat(actions[:, None], lanes, axis=1)
        return self.tracked(
            start, states, everywhere, np.broadcast_to(gain, (steps, lanes, *gain.shape))
        )

    def tracked(
        self, start: FloatArray, states: FloatArray, actions: FloatArray, gains: FloatArray
    ) -> Motions:
        """Return the motions from `start`, (B, 2c), that track others by feedback."""
        zeros = np.zeros(len(start))
        return self.follow(start, Motions(states, actions, gains, zeros, zeros + _DAMPING))

    def follow(self, start: FloatArray, motions: Motions) -> Motions:
        """Return the motions from `start`, (B, 2c), under the same actions and feedback."""
        reached, taken = self._roll_out(start, *motions[:3])
        cost = self.cost.total(reached, taken)
        return motions._replace(states=reached, actions=taken, cost=cost)

    def improve(self, motions: Motions) -> Motions:
        """Return the motions after an iteration; those for which it finds none better stay."""
        changes, gains = self._recursion(motions)
        tries, lanes = len(_STEP_LENGTHS), np.arange(len(motions.cost))
        actions = motions.actions + _STEP_LENGTHS[:, None, None, None] * changes
        several = np.moveaxis(actions, 0, 1).reshape(len(changes), -1, changes.shape[2])
        nominal, feedback = np.tile(motions.states, (1, tries, 1)), np.tile(gains, (1, tries, 1, 1))
        states, actions = self._roll_out(nominal[0], nominal, several, feedback)
        cost = self.cost.total(states, actions).reshape(tries, -1)
        best = cost.argmin(axis=0)
        better = cost[best, lanes] < motions.cost
        place = best * len(lanes) + lanes
        low, high = _DAMPING_RANGE
        factor = np.where(better & (best < 2), 1.0 / 3.0, 4.0)
        return Motions(
            np.where(better[:, None], states[:, place], motions.states),
            np.where(better[:, None], actions[:, place], motions.actions),
            gains,
            np.where(better, cost[best, lanes], motions.cost),
            np.clip(motions.damping * factor, low, high),
        )

    def _roll_out(
        self, start: FloatArray, states: FloatArray, actions: FloatArray, gains: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return states and actions of the motions with feedback, from `start`, (B, 2c)."""
        reached, taken = np.empty(states.shape), np.empty(actions.shape)
        reached[0] = start
        for k, action in enumerate(actions):
            feedback = gains[k] @ (reached[k] - states[k])[..., None]
            taken[k] = np.clip(action - feedback[..., 0], -1.0, 1.0)
            reached[k + 1] = self.model.advance(taken[k]) if k else self.model(start, taken[k])
        return reached, taken

    def _recursion(self, motions: Motions) -> tuple[FloatArray, FloatArray]:
        """Return changes of the actions, (steps, B, joints), and gains, (..., joints, 2c)."""
        states, actions = motions.states, motions.actions
        steps, joints, size = len(actions), actions.shape[2], states.shape[2]
        a, b = self._derivatives(states[:-1], actions)
        first, second = self.cost.slopes(states)
        weight, damping = 2.0 * self.cost.action_weight, motions.damping[:, None, None]
        changes, gains = np.empty_like(actions), np.empty((*actions.shape, size))
        value, curvature = first[-1][..., None], second[-1][..., None] * np.eye(size)
        for k in reversed(range(steps)):
            ahead = _transposed(b[k]) @ curvature
            hessian = ahead @ b[k] + weight * np.eye(joints)
            gradient = weight * actions[k] + (_transposed(b[k]) @ value)[..., 0]
            bounds = -1.0 - actions[k], 1.0 - actions[k]
            changes[k], gains[k] = _bounded_minimum(
                hessian + damping * np.eye(joints), gradient, ahead @ a[k], *bounds
            )
            closed_loop = a[k] - b[k] @ gains[k]
            by_action = weight * (actions[k] + changes[k])[..., None]
            value = value + _transposed(ahead) @ changes[k][..., None]
            value = first[k][..., None] + _transposed(closed_loop) @ value
            value -= _transposed(gains[k]) @ by_action
            curvature = _transposed(closed_loop) @ curvature @ closed_loop
            curvature += weight * _transposed(gains[k]) @ gains[k]
            curvature = 0.5 * (curvature + _transposed(curvature))  # errors in what differs grow
            curvature[:, range(size), range(size)] += second[k]
        return changes, gains

    def _derivatives(
        self, states: FloatArray, actions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of all steps, (steps, B, 2c, 2c) and (steps, B, 2c, joints)."""
        flat = states.reshape(-1, states.shape[2]), actions.reshape(-1, actions.shape[2])
        try:
            a, b = self.model.derivatives(*flat)
        except FloatingPointError as error:
            first = self.model.diverges(*flat).reshape(states.shape[:2]).any(axis=1).argmax()
            raise FloatingPointError(
                f"the plan diverges in step {first} of the horizon: give the environment shorter "
                "steps, or more substeps"
            ) from error
        return a.reshape(*states.shape, -1), b.reshape(*states.shape, -1)


def _bounded_minimum(
    hessian: FloatArray, gradient: FloatArray, both: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the changes of the actions within bounds that minimise a quadratic cost, and gains.

    Where they would leave the bounds, one action after the other is taken to its best within them.
    Those that end at a bound are held there, without feedback, and the others are solved for.
    """
    right = np.concatenate([-gradient[..., None], both], axis=2)
    solved: FloatArray = np.asarray(np.linalg.solve(hessian, right), np.float64)
    change = np.clip(solved[..., 0], low, high)
    if (change == solved[..., 0]).all():
        return change, solved[..., 1:]
    joints = gradient.shape[1]
    for joint in [*range(joints)] * (1 if joints == 1 else _SWEEPS):
        slope = gradient[:, joint] + (hessian[:, joint] * change).sum(axis=1)
        best = change[:, joint] - slope / hessian[:, joint, joint]
        change[:, joint] = np.clip(best, low[:, joint], high[:, joint])
    free = (change > low) & (change < high)
    held = np.where(free, 0.0, change)
    matrix = np.where(free[:, :, None] & free[:, None], hessian, np.eye(joints))
    right[..., 0] -= (hessian @ held[..., None])[..., 0]
    right = np.where(free[..., None], right, 0.0)
    right[..., 0] += held
    solved = np.asarray(np.linalg.solve(matrix, right), np.float64)
    return np.clip(solved[..., 0], low, high), solved[..., 1:]


def _transposed(matrices: FloatArray) -> FloatArray:
    return np.swapaxes(matrices, 1, 2)
