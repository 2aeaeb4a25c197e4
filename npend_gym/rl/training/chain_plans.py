"""Plans that are tracked without a clock, and those for chains that differ from the nominal one.

Plans for other chains make an expert that knows the chain of each environment. The plan for the
nominal chain is found from a guess. The plan for another chain is found from the plan for the most
similar chain that has one already. For each chain the plan is kept whose actions are closest to the
actions of the nominal plan. So similar chains have similar plans: a student learns what changes
smoothly with the chain.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import replanned
from npend_gym.rl.controllers.step_model import state_of, wrapped
from npend_gym.rl.controllers.tracking import PlannedTransition, Tracking, track
from npend_gym.rl.controllers.transitions import Pair
from npend_gym.rl.evaluation.settings import keywords_of

_BACK, _AHEAD = 2, 4  # steps within which the nearest state of a plan is sought
_START = 0.05  # rad and rad/s, as far as episodes start from the beginning of a plan

# Of one rod or joint at a time: what parameters of the chain are multiplied by, or their values
_SMALLEST, _LARGEST = 0.75, 1.25
_SLIGHTLY = 0.95, 0.97, 0.985, 1.015, 1.03, 1.05  # to compare plans
_DAMPINGS = 0.025, 0.05, 0.075, 0.1  # N m s/rad, added
# Of all rods or joints: how many chains, between which factors or values
_ALL = {"masses": (20, 0.88, 1.12), "lengths": (40, 0.93, 1.07), "damping": (20, 0.00625, 0.13)}
# Of each rod or joint by itself, drawn
_EACH = {"masses": (30, 0.88, 1.12), "lengths": (40, 0.93, 1.07), "damping": (36, 0.0, 0.12)}
_NEAREST = 3  # plans from which another one is sought
_DAMPING_UNIT = 1.0 / 3.0  # N m s/rad: what changes a plan as much as a factor of two

Changes = Mapping[str, FloatArray]


class PlanTracker:
    """Plans of equal length, one of them in each sub-environment, each tracked by its own feedback.

    The cost of the feedback, not the clock, decides at which state of a plan a chain is: a student
    that is late, and knows no clock, is not far from the plan.

    `start_cost` is the mean cost at the start of episodes, over that of starts near the beginning
    of a plan. In a mode with goals, each plan leads from the first to the second of one of the
    `pairs` of equilibria.
    """

    chains: Sequence[Changes] = ()  # of which each has a plan, the nominal one first

    def __init__(
        self,
        config: EnvConfig,
        plans: Sequence[PlannedTransition],
        start_cost: float = 1.0,
        pairs: Sequence[Pair] = (),
    ) -> None:
        self._config = config
        self.pairs: Sequence[Pair] = pairs
        self.steps: int = len(plans[0].gains)
        idle = np.zeros((1, config.joints.size))
        self._states = np.array([plan.nominal.states for plan in plans])
        self._actions = np.array([[*plan.nominal.actions, *idle] for plan in plans])
        gains = [[*plan.gains, plan.hold_goal.gain] for plan in plans]
        self.gains: FloatArray = np.array(gains)  # (plans, steps + 1, joints, 2c)
        self._costs = np.array([plan.costs for plan in plans])
        weights = [[*plan.action_weights, plan.action_weights[-1]] for plan in plans]
        self._weights = np.array(weights)
        unit = np.trace(self._costs[:, 0], axis1=1, axis2=2) * _START**2 / 3.0
        self._unit = start_cost * unit
        self.begin(np.zeros(0, np.int64))

    @property
    def trajectories(self) -> list[FloatArray]:
        """The states, (plans, steps + 1, 2c), and actions, (plans, steps, joints), of the plans."""
        return [self._states, self._actions[:, :-1]]

    def begin(self, which: NDArray[np.int64], round_: int = 0) -> None:
        """Begin episodes in sub-environments with the plans of these numbers, (B,)."""
        del round_
        self._which, self._phase = which, np.zeros(which.size, np.int64)

    def tracking(self, info: Mapping[str, Any]) -> Tracking:
        """Feedback of the plans in the states of all environments, and how far they are from them.

        From the last step of a plan on, or wherever that is nearer, the goal is held.
        """
        states, which = state_of(self._config, info), self._which
        steps, lanes = self.steps, np.arange(len(which))
        self._phase[info["time"] == 0.0] = 0
        near = np.clip(self._phase[:, None] + [*range(-_BACK, _AHEAD + 1), steps], 0, steps)
        away = states[:, None] - self._states[which[:, None], near]
        away = np.where(near[..., None] == steps, wrapped(self._config, away), away)
        costs = self._costs[which[:, None], near]
        cost = np.einsum("bwi,bwij,bwj->bw", away, costs, away)
        nearest = cost.argmin(axis=1)
        phase, deviation = near[lanes, nearest], away[lanes, nearest]
        feedback = np.einsum("bji,bi->bj", self.gains[which, phase], deviation)
        relative_cost = cost[lanes, nearest] / self._unit[which]
        actions, weights = self._actions[which, phase] - feedback, self._weights[which, phase]
        self._phase = phase
        return Tracking(actions, deviation, relative_cost, weights)

    def rest(
        self, states: FloatArray, lanes: NDArray[np.int64], steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the next steps of the plans of some lanes; after its end a plan holds the goal.

        These are states, (steps + 1, B, 2c), whole turns away from the plan where the chain is;
        actions, (steps, B, joints); and gains.
        """
        which, ahead = self._which[lanes], np.arange(steps + 1)[:, None]
        steps_of = np.minimum(self._phase[lanes] + ahead, self.steps)
        nominal = self._states[which, steps_of]
        away = states - nominal[0]
        turns = away - wrapped(self._config, away)
        before = which, steps_of[:-1]
        return nominal + turns, self._actions[before], self.gains[before]


def parameters(chain: Chain) -> dict[str, FloatArray]:
    """Return the parameters that may be wrong, by name, (n,) each."""
    names = ["masses", "lengths", "damping"]
    names += [] if chain.has_bobs else ["centres", "inertias"]
    return {name: getattr(chain, name) for name in names}


def wrong_chains(chain: Chain, seed: int, factors: int) -> list[Changes]:
    """Return parameters of chains, by name, (n,) each: of one rod wrong, of all, of each.

    Parameters of one rod are multiplied by a number of factors below 1, and as many above.
    """
    n, rng, every = chain.n, np.random.default_rng(seed), list[Changes]()
    nominal = parameters(chain)
    tried = np.delete(np.linspace(_SMALLEST, _LARGEST, 2 * factors + 1), factors)  # not 1
    for i in range(n):
        every += [_one_wrong(nominal, name, i, k) for name in _never_zero(nominal) for k in tried]
        one: FloatArray = np.arange(n) == i
        every += [{"damping": nominal["damping"] + one * value} for value in _DAMPINGS]
    for name, (count, low, high) in _ALL.items():
        every += [_scaled(nominal, name, np.full(n, k)) for k in np.linspace(low, high, count)]
    for name, (count, low, high) in _EACH.items():
        every += [_scaled(nominal, name, drawn) for drawn in rng.uniform(low, high, (count, n))]
    return every


def slightly_wrong(chain: Chain) -> list[Changes]:
    """Return parameters of chains, by name, (n,) each: of one rod slightly wrong."""
    nominal, rods = parameters(chain), range(chain.n)
    triples = itertools.product(_never_zero(nominal), rods, _SLIGHTLY)
    return [_one_wrong(nominal, *triple) for triple in triples]


def _never_zero(nominal: Changes) -> list[str]:
    return [name for name in nominal if name != "damping"]


def _one_wrong(nominal: Changes, name: str, i: int, factor: float) -> Changes:
    """Return a parameter that is wrong for rod i alone."""
    value = nominal[name]
    return {name: np.where(np.arange(value.size) == i, factor, 1.0) * value}


def _scaled(nominal: Changes, name: str, by: FloatArray) -> Changes:
    """Return a parameter times `by`; damping, which may be zero, plus it."""
    value = nominal[name]
    return {name: value + by if name == "damping" else value * by}


class ChainPlans(PlanTracker):
    """Plans for many chains, each tracked by the feedback for its own chain.

    `base` is the plan for the nominal chain, that of `config`; `wrong` has what other chains have
    in place of its parameters. `start_cost` is the mean cost at the start of episodes, over that of
    starts near the beginning of a plan.
    """

    def __init__(
        self,
        config: EnvConfig,
        base: PlannedTransition,
        wrong: Sequence[Changes] = (),
        start_cost: float = 1.0,
    ) -> None:
        self._config = config
        nominal = parameters(config.chain)
        whole = [nominal | dict(changes) for changes in wrong]
        near_first = sorted(whole, key=lambda each: self._distance(nominal, each))
        found: list[tuple[Changes, PlannedTransition]] = [(nominal, base)]
        for changes in near_first:
            plan = self._plan(changes, found)
            if plan is not None:
                found.append((changes, plan))
        # the nominal one, then those for which a plan was found
        self.chains: Sequence[Changes] = [changes for changes, _ in found]
        super().__init__(config, [plan for _, plan in found], start_cost)

    def _distance(self, one: Changes, other: Changes) -> float:
        """Return how different two chains are."""
        away = 0.0
        for name, value in parameters(self._config.chain).items():
            unit = np.where(value == 0.0, 1.0, value) if name != "damping" else _DAMPING_UNIT
            away += float(np.abs((one[name] - other[name]) / unit).sum())
        return away

    def _plan(
        self, changes: Changes, found: Sequence[tuple[Changes, PlannedTransition]]
    ) -> PlannedTransition | None:
        """Return the plan for a chain, or None where none of the plans nearby leads to one."""
        own = self._config
        chain = Chain.from_dict(own.chain.as_dict() | {k: v.tolist() for k, v in changes.items()})
        keywords: dict[str, Any] = keywords_of(own) | {"chain": chain}
        config = EnvConfig(**keywords)
        base = found[0][1].nominal
        if np.array_equal(base.states[0], base.states[-1]):  # nothing is to move
            return track(config, base, 0.0)
        near = sorted(found, key=lambda each: self._distance(changes, each[0]))
        for _, plan in near[:_NEAREST]:
            similar = replanned(config, plan.nominal, like=base)
            if similar is not None:
                return similar
        return None
