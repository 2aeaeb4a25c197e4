"""Plans for chains that differ from the nominal one: a teacher that knows the chain of each lane.

All follow the same idea. The plan for the nominal chain is found from a guess, and that for another
chain from the plan for the most similar chain that has one already. Of all plans for it that whose
actions are most like those of the nominal chain is looked for, so that similar chains have similar
plans: a student learns what changes smoothly with the chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.envs import EnvConfig
from npend_gym.rl.angles import wrap
from npend_gym.rl.controllers.planning import PlannedTransition, Tracking, replanned

# Of one rod or joint at a time: what parameters of the chain are multiplied by, or their values
_FACTORS = 0.75, 0.8125, 0.875, 0.9375, 1.0625, 1.125, 1.1875, 1.25
_DAMPINGS = 0.025, 0.05, 0.075, 0.1  # N m s/rad
# Of all rods or joints: how many chains, between which factors or values
_ALL = {"masses": (20, 0.88, 1.12), "lengths": (40, 0.93, 1.07), "damping": (20, 0.00625, 0.13)}
# Of each rod or joint by itself, drawn
_EACH = {"masses": (30, 0.88, 1.12), "lengths": (40, 0.93, 1.07), "damping": (36, 0.0, 0.12)}
_NEAREST = 3  # plans from which another one is sought
_DAMPING_UNIT = 1.0 / 3.0  # N m s/rad: what changes a plan as much as a factor of two
_BACK, _AHEAD = 2, 4  # steps within which the nearest state of a plan is sought
_START = 0.05  # rad and rad/s, as far as episodes start from the beginning of a plan

Changes = Mapping[str, FloatArray]


def wrong_chains(chain: Chain, seed: int) -> list[Changes]:
    """Return parameters of chains, by name, (n,) each: of one rod wrong, of all, of each."""
    n, rng, every = chain.n, np.random.default_rng(seed), list[Changes]()
    unit = {"masses": chain.masses, "lengths": chain.lengths, "damping": np.ones(n)}
    for i in range(n):
        one: FloatArray = np.arange(n) == i
        for name in ("masses", "lengths"):
            every += [{name: np.where(one, k * unit[name], unit[name])} for k in _FACTORS]
        every += [{"damping": np.where(one, value, 0.0)} for value in _DAMPINGS]
    for name, (count, low, high) in _ALL.items():
        every += [{name: factor * unit[name]} for factor in np.linspace(low, high, count)]
    for name, (count, low, high) in _EACH.items():
        every += [{name: unit[name] * drawn} for drawn in rng.uniform(low, high, (count, n))]
    return every


class ContextPlans:
    """Swing-ups of many chains, each tracked by the feedback for its own chain.

    Which state of a plan a chain is at is not told by the clock but by the feedback's cost: a
    student that is late, and knows no clock, is not far from the plan.

    Parameters
    ----------
    config : EnvConfig
        Of the nominal chain, with one motor at the base.
    base : PlannedTransition
        The plan for the nominal chain.
    chains : sequence of mapping
        What other chains have in place of the nominal chain's parameters.

    Attributes
    ----------
    masses, lengths, damping : ndarray, shape (plans, n)
        Of the nominal chain first, then of those chains for which a plan was found.
    steps : int
        Of every plan.
    """

    def __init__(
        self, config: EnvConfig, base: PlannedTransition, chains: Sequence[Changes]
    ) -> None:
        self._config, own = config, config.chain
        nominal = {"masses": own.masses, "lengths": own.lengths, "damping": own.damping}
        whole = [nominal | dict(changes) for changes in chains]
        near_first = sorted(whole, key=lambda each: self._distance(nominal, each))
        found: list[tuple[Changes, PlannedTransition]] = [(nominal, base)]
        for changes in near_first:
            plan = self._plan(changes, found)
            if plan is not None:
                found.append((changes, plan))
        self.masses, self.lengths, self.damping = (
            np.array([changes[name] for changes, _ in found]) for name in nominal
        )
        plans = [plan for _, plan in found]
        self.steps = len(base.gains)
        self._states = np.array([plan.nominal.states for plan in plans])
        self._actions = np.array([[*plan.nominal.actions, [0.0]] for plan in plans])
        self._gains = np.array([[*plan.gains, plan.hold_goal.gain] for plan in plans])
        self._costs = np.array([plan.costs for plan in plans])
        weights = [[*plan.action_weights, plan.action_weights[-1]] for plan in plans]
        self._weights = np.array(weights)
        self._unit = np.trace(self._costs[:, 0], axis1=1, axis2=2) * _START**2 / 3.0

    def __len__(self) -> int:
        return len(self.masses)

    def _distance(self, one: Changes, other: Changes) -> float:
        units = {"masses": 1.0, "lengths": 1.0, "damping": _DAMPING_UNIT}
        own = {"masses": self._config.chain.masses, "lengths": self._config.chain.lengths}
        return sum(
            float(np.abs((one[name] - other[name]) / (unit * own.get(name, 1.0))).sum())
            for name, unit in units.items()
        )

    def _plan(
        self, changes: Changes, found: Sequence[tuple[Changes, PlannedTransition]]
    ) -> PlannedTransition | None:
        """Return the plan for a chain, or None where none of the plans nearby leads to one."""
        own = self._config
        chain = Chain.from_dict(own.chain.as_dict() | {k: v.tolist() for k, v in changes.items()})
        config = EnvConfig(
            chain=chain, mode=own.mode, max_torque=own.max_torque, dt=own.dt, substeps=own.substeps
        )
        near = sorted(found, key=lambda each: self._distance(changes, each[0]))
        for _, plan in near[:_NEAREST]:
            similar = replanned(config, plan.nominal, like=found[0][1].nominal)
            if similar is not None:
                return similar
        return None

    def tracking(
        self, which: NDArray[np.int64], phase: NDArray[np.int64], states: FloatArray
    ) -> tuple[NDArray[np.int64], Tracking]:
        """Return at which steps of their plans lanes are, and what the plans say about them.

        Parameters
        ----------
        which : ndarray, int64, shape (B,)
            Numbers of the plans.
        phase : ndarray, int64, shape (B,)
            Where they were a step ago. From the last step of a plan on, the goal is held.
        states : ndarray, shape (B, 2n)
        """
        n, steps, lanes = self._config.n, self.steps, np.arange(len(which))
        near = np.clip(phase[:, None] + np.arange(-_BACK, _AHEAD + 1), 0, steps)
        away = states[:, None] - self._states[which[:, None], near]
        wrapped = wrap(away[..., :n])
        away[..., :n] = np.where(near[..., None] == steps, wrapped, away[..., :n])
        costs = self._costs[which[:, None], near]
        cost = np.einsum("bwi,bwij,bwj->bw", away, costs, away)
        nearest = cost.argmin(axis=1)
        phase, deviation = near[lanes, nearest], away[lanes, nearest]
        feedback = np.einsum("bji,bi->bj", self._gains[which, phase], deviation)
        relative_cost = cost[lanes, nearest] / self._unit[which]
        actions, weights = self._actions[which, phase] - feedback, self._weights[which, phase]
        return phase, Tracking(actions, deviation, relative_cost, weights)
