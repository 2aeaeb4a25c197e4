"""Who teaches: plans that are found, and feedback where none is needed.

A student's actions are never quite the expert's. How far this leads astray differs much from plan
to plan, so that some cannot be learned. Variants of a plan can be tried, to keep those along which
noisy actions, slightly wrong chains and lags of motors lead less far away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from npend_gym._checks import BoolArray, FloatArray
from npend_gym._progress import bar
from npend_gym.envs import EnvConfig
from npend_gym.envs.modes import Calm, SwingUp
from npend_gym.rl.controllers.ilqr import Motions
from npend_gym.rl.controllers.mpc import MPC
from npend_gym.rl.controllers.planning import planned_swing_up, planned_transition, replanned
from npend_gym.rl.controllers.step_model import at_rest, state_of
from npend_gym.rl.controllers.tracking import PlannedTransition, Tracking, track
from npend_gym.rl.controllers.transcription import NominalTrajectory
from npend_gym.rl.controllers.transitions import Pair, pairs_of
from npend_gym.rl.evaluation.seeds import episode_seeds
from npend_gym.rl.evaluation.settings import keywords_of, setting_of
from npend_gym.rl.policies.observations import observation_of
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.policies.shipped import find_policy
from npend_gym.rl.training.chain_plans import (
    ChainPlans,
    Changes,
    PlanTracker,
    parameters,
    slightly_wrong,
    wrong_chains,
)
from npend_gym.rl.training.error_lanes import CHAIN, NOTHING, SEVERAL, ErrorLanes

_START, _STANDS = 1e-9, 0.01  # rad and rad/s from hanging and from standing
# standard deviation of the noise in each sub-environment, over `noise_std`
_NOISE = np.repeat([0.02, 0.03, 0.04, 0.06], 64) / 0.1
_LAGGING = 32.0  # sub-environments in which the motor has a lag
_LOST, _AFTER = 300.0, 10  # cost over the mean at the start; steps after the plan
_OF_PLANS = "speed_weight", "change_weight", "slow_from", "cart_position"  # that swing up
_CHANGE, _SMALLEST, _LARGEST = 0.15, 0.01, 0.4  # of actions, over their limit: at first, and ends
_GROWS, _SHRINKS = 1.8, 0.93  # after a variant that is better, or not
_REPLANNED, _BEGINS = 4, 30.0  # MPC helps in one round of so many; cost from which it acts
_STATE = "theta", "omega", "cart_position", "cart_velocity"  # in `info`
_WIDTHS, _REACH = (1.0, 2.0, 4.0, 8.0), 15.0  # of changes, in steps


class Rescued:
    """An expert that leaves a chain that it has lost to a rescuer, until that brings it back.

    `tracking` tells lower costs than `lost` where the rescuer helps: there no chain is ever lost.
    """

    def __init__(
        self, expert: PlanTracker, rescuer: PolicyRescuer | Replanning, lost: float
    ) -> None:
        self._expert, self._rescuer, self._lost = expert, rescuer, lost
        self.chains: Sequence[Changes] = expert.chains
        self.pairs: Sequence[Pair] = expert.pairs
        self.trajectories: list[FloatArray] = expert.trajectories
        self.gains: FloatArray = expert.gains

    def begin(self, which: NDArray[np.int64], round_: int) -> None:
        """Begin episodes in sub-environments with the chains of these numbers, (B,)."""
        self._expert.begin(which, round_)
        self._helped = self._rescuer.helps(which, round_)

    def tracking(self, info: dict[str, Any]) -> Tracking:
        """Return the actions, and how far the states are from where they should be."""
        tracking, helped = self._expert.tracking(info), self._helped
        actions, cost = tracking.actions.copy(), tracking.relative_cost
        lanes = np.flatnonzero(helped & (cost >= self._rescuer.begins))
        if lanes.size > 0:
            of_lanes = {key: info[key][lanes] for key in (*_STATE, "time") if key in info}
            actions[lanes] = self._rescuer.actions(of_lanes, lanes)
        below = np.where(helped, np.minimum(cost, np.nextafter(self._lost, 0.0)), cost)
        return tracking._replace(actions=actions, relative_cost=below)


Expert = PlanTracker | Rescued


class PolicyRescuer:
    """A policy without a memory; it helps every chain."""

    def __init__(self, policy: Policy, begins: float) -> None:
        self._policy = policy
        self.begins: float = begins  # cost of a deviation from which it acts

    def helps(self, which: NDArray[np.int64], round_: int) -> BoolArray:
        """Return in which sub-environments it acts: in all."""
        del round_
        return np.ones(which.size, np.bool_)

    def actions(self, info: dict[str, Any], lanes: NDArray[np.int64]) -> FloatArray:
        """Return the actions in some sub-environments; `info` is of these alone."""
        del lanes
        state = {key: info[key] for key in _STATE if key in info}
        return self._policy(observation_of(self._policy.config, **state)).astype(np.float64)


class Replanning(MPC):
    """MPC, for the nominal chain alone, and in some rounds alone: it takes long.

    Its first plan is what is left of the expert's, with feedback. So what it does is near what the
    expert does.
    """

    begins: float = _BEGINS

    def __init__(self, config: EnvConfig, plans: ChainPlans) -> None:
        super().__init__(config)
        self._plans = plans

    def helps(self, which: NDArray[np.int64], round_: int) -> BoolArray:
        """Forget the episodes before, and return in which sub-environments it acts."""
        self.reset()
        return (which == 0) & (round_ % _REPLANNED == 0)

    def actions(self, info: dict[str, Any], lanes: NDArray[np.int64]) -> FloatArray:
        """Return the actions in some sub-environments; `info` is of these alone."""
        return self.plan(state_of(self._config, info), info["time"], lanes)

    def _first_plan(self, states: FloatArray, lanes: NDArray[np.int64]) -> Motions:
        """Return the rest of the expert's plan, improved once."""
        rest = self._plans.rest(states, lanes, len(self._guess))
        return self._improved(self._ilqr.tracked(states, *rest), 1)


def expert_of(
    settings: Any, config: EnvConfig, guess: int, progress: str | None = None,
    kept: Sequence[FloatArray] = (),
) -> Expert | None:  # fmt: skip
    """Return the expert that a guess leads to, if any.

    With goals an expert has plans for all pairs. Tasks that begin where they end have feedback
    about their equilibrium. Nothing calms the chain before a plan begins: without a clock, holding
    looks like leaving. `settings` are those of `imitation`; guesses are counted from 0. `progress`
    is the title of what shows how far planning is. `kept` are the `trajectories` of an expert of
    the same settings and guess: its plans are made from these, and not sought again.
    """
    known = (track(config, NominalTrajectory(*each), 0.0) for each in zip(*kept, strict=True))
    swings_up = isinstance(config.mode, SwingUp)
    if guess > 0 and not swings_up:
        return None  # it would be the same expert
    if config.mode.has_goals:
        pairs = [*pairs_of(config.n)]
        plans = [*known]
        if not plans:
            shown = _shown(pairs, progress, "pairs")
            plans = [_transition(settings, config, pair) for pair in shown]
        return PlanTracker(config, plans, pairs=pairs)
    wrong = {CHAIN, SEVERAL} & {name for name, share in settings.errors.items() if share > 0.0}
    chains = wrong_chains(config.chain, settings.seed, settings.chain_factors) if wrong else []
    if not swings_up:
        return _regulator(settings, config, chains)
    try:
        plan = next(known, None) or _swing_up(settings, config, guess, progress)
        plans = ChainPlans(config, plan, chains)
    except RuntimeError:  # this guess leads to no trajectory
        return None
    if settings.rescuer == "mpc":
        return Rescued(plans, Replanning(config, plans), settings.lost)
    if settings.rescuer:
        policy = rescuing_policy(settings.rescuer, config)
        return Rescued(plans, PolicyRescuer(policy, settings.lost), settings.lost)
    return plans


def _shown(planned: Sequence[Any], title: str | None, unit: str) -> Any:
    """Return a loop over what is planned, which shows how far it is if it has a title."""
    return bar(planned, title, unit=unit, leave=False) if title else planned


def rescuing_policy(name: str, config: EnvConfig) -> Policy:
    """Return the policy of a rescuer, or say why it cannot act in an environment."""
    policy = find_policy(name)
    own = policy.config
    if policy.has_memory or own.observe_context or own.observes_goals:
        raise ValueError(
            "rescuer must be a policy that observes the present state alone, without memory, goal "
            f'and context, got {name!r}: rescuer="" (--set rescuer=) leaves it out, "mpc" plans '
            "again"
        )
    own_kind, needed = (
        f"n={each.n}, cart={each.has_cart}, motors {each.joints.tolist()}, limits "
        f"{each.action_limits.tolist()}"
        for each in (own, config)
    )
    if own_kind != needed:
        raise ValueError(
            "rescuer must be a policy of the same number of rods, cart, motors and limits, got "
            f"{name!r} with {own_kind} for an environment with {needed}: "
            f'rescuer="" (--set rescuer=) leaves it out, "mpc" plans again'
        )
    return policy


def _transition(settings: Any, config: EnvConfig, pair: Pair) -> PlannedTransition:
    """Return the plan between a pair of equilibria from which errors lead least far astray.

    Where no guess of the wanted kind leads to a plan, the first plan of the other kind counts. Of
    the best one variants are tried.
    """
    kind = settings.plan_guess
    others = _plans_between(settings, config, pair, "mpc" if kind == "waves" else "waves")
    found = [*_plans_between(settings, config, pair, kind)] or [*islice(others, 1)]
    if not found:
        raise RuntimeError(f"no guess led from {pair[0]} to {pair[1]}: give it more guesses")
    errors = settings.noise_std, settings.error_weight
    best = min(found, key=lambda plan: astray(config, plan, *errors))
    return steadied(config, best, settings.variants, settings.seed, *errors)


def _plans_between(
    settings: Any, config: EnvConfig, pair: Pair, kind: str
) -> Iterator[PlannedTransition]:
    """Yield the plans to which guesses of a kind lead."""
    start, goal = np.pi * np.array(pair)
    for guess in range(settings.guesses):
        seed = guess + settings.guesses * settings.seed
        options: dict[str, Any] = {"tries": 1, "guess": kind, "seed": seed}
        with suppress(RuntimeError):  # this guess leads to no trajectory
            yield planned_transition(config, start, goal, settings.seconds, **options)


def _swing_up(
    settings: Any, config: EnvConfig, guess: int, progress: str | None = None
) -> PlannedTransition:
    """Return the plan for the nominal chain."""
    seed = settings.plan_seed
    seed = guess + (settings.guesses * settings.seed if seed is None else seed)
    options: dict[str, Any] = {"tries": settings.tries, "guess": settings.plan_guess, "seed": seed}
    options |= {name: getattr(settings, name) for name in _OF_PLANS}
    plan = planned_swing_up(config, settings.seconds, **options)
    errors = settings.noise_std, settings.error_weight
    return steadied(config, plan, settings.variants, seed, *errors, progress=progress)


def _regulator(settings: Any, config: EnvConfig, chains: list[Changes]) -> ChainPlans:
    """Return LQR about the equilibrium in which the mode succeeds: it hangs in "calm"."""
    rest = at_rest(config, 0.0 if isinstance(config.mode, Calm) else np.pi)
    idle = NominalTrajectory(np.stack([rest, rest]), np.zeros((1, config.joints.size)))
    plan = track(config, idle, 0.0)
    envs = setting_of(settings.env).make(settings.num_envs)
    seeds = episode_seeds("training", settings.num_envs, run=settings.seed, spacing=100_000)
    _, info = envs.reset(seed=seeds.start)
    envs.close()
    return ChainPlans(config, plan, chains, float(plan.tracking(info).relative_cost.mean()))


def steadied(
    config: EnvConfig, plan: PlannedTransition, variants: int, seed: int, *errors: float,
    progress: str | None = None,
) -> PlannedTransition:  # fmt: skip
    """Return the plan, or that of its variants along which errors lead least far `astray`.

    `errors` are what that function takes. Each variant is a motion to the same end. Its actions are
    closest to the actions of the best one so far with a smooth random change. The change grows
    after a success and else shrinks.
    """
    if variants == 0:
        return plan
    rng, size = np.random.default_rng([seed, 3]), _CHANGE
    least = astray(config, plan, *errors)
    for _ in _shown(range(variants), progress, "variants"):
        states, actions = plan.nominal
        change = _smooth_change(rng, len(actions))[:, None]
        wanted = np.clip(actions + size * change, -1.0, 1.0)
        variant = replanned(config, plan.nominal, like=NominalTrajectory(states, wanted))
        if variant is not None and (cost := astray(config, variant, *errors)) < least:
            plan, least, size = variant, cost, min(_LARGEST, _GROWS * size)
        else:
            size = _SHRINKS * size if size > _SMALLEST else _LARGEST
    return plan


def _smooth_change(rng: np.random.Generator, steps: int) -> FloatArray:
    """Return a random change of all actions, or of those about a random step."""
    change = gaussian_filter1d(rng.normal(size=steps), rng.choice(_WIDTHS))
    change /= change.std()
    if rng.random() < 0.5:
        change *= np.exp(-0.5 * ((np.arange(steps) - rng.uniform(0.0, steps)) / _REACH) ** 2)
    return change


def astray(
    config: EnvConfig, plan: PlannedTransition, noise_std: float, error_weight: float = 0.0
) -> float:
    """Return how far errors lead from a plan that is tracked: a mean logarithm.

    It is that of the largest cost of the deviation in an environment, over the mean at the start.
    The actions of some environments have noise. Of others the chain is slightly wrong, which the
    feedback does not know, or the motor has a lag, which the expert knows; `error_weight` is the
    weight of the mean of each of these.
    """
    plans, rng, noisy = ChainPlans(config, plan), np.random.default_rng(0), _NOISE.size
    nominal, counts = parameters(config.chain), {NOTHING: float(noisy)}
    chains = [nominal, *(nominal | dict(changes) for changes in slightly_wrong(config.chain))]
    if error_weight > 0.0:
        counts |= {CHAIN: 2.0 * len(chains), "motor_lag": _LAGGING}
    size = round(sum(counts.values()))
    lanes = ErrorLanes(setting_of(keywords_of(config)), size, counts, plans.steps)
    _, info = lanes.reset(0, chains, np.random.default_rng(1), _ends(config, plan, size))
    plans.begin(np.zeros(size, np.int64))
    std = np.zeros((size, 1))
    std[:noisy, 0] = noise_std * _NOISE
    worst, lost_at = np.zeros(size), np.full(size, plans.steps)
    for k in range(plans.steps + _AFTER):
        tracking = lanes.against_lag(plans.tracking(info))
        known = worst < _LOST
        worst[known] = np.maximum(worst, tracking.relative_cost)[known]
        lost_at[known] = min(k, plans.steps)
        noise = std * rng.normal(size=tracking.actions.shape)
        actions = (tracking.actions + noise).clip(-1.0, 1.0)
        *_, info = lanes.step(np.where(known[:, None], actions, 0.0))
    lanes.close()
    lost = worst >= _LOST  # the later, the better
    worst[lost] = _LOST * np.exp(1.0 - 0.5 * lost_at[lost] / plans.steps)
    of_noise, *of_errors = (np.log(worst[part]).mean() for part in lanes.parts)
    return float(of_noise + error_weight * sum(of_errors))


def _ends(config: EnvConfig, plan: PlannedTransition, size: int) -> dict[str, FloatArray] | None:
    """Return the options of `reset` by which lanes begin where a plan does, in modes with goals."""
    if not config.mode.has_goals:
        return None
    ends = np.pi * np.remainder(np.rint(plan.nominal.states[[0, -1], : config.n] / np.pi), 2.0)
    return {"start": np.tile(ends[0], (size, 1)), "goal": np.tile(ends[1], (size, 1))}
