"""Planned transitions: a trajectory to an equilibrium within the torque limit, tracked by LQR.

`transcription.py` finds the trajectory. With the tracking, this is what is known for the swing-up
of a double and a triple pendulum on a cart: Graichen, Treuer, Zeitz, Automatica 43 (2007), 63-71,
and Glück, Eder, Kugi, Automatica 49 (2013), 801-808.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.random import default_rng
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.envs.goals import checked_equilibrium
from npend_gym.envs.modes import Balance, Calm
from npend_gym.rl.controllers.mpc import MPC
from npend_gym.rl.controllers.step_model import (
    StepModel,
    check_config,
    checked_place,
)
from npend_gym.rl.controllers.tracking import START, PlannedTransition, rest_of, track
from npend_gym.rl.controllers.transcription import (
    MAX_PLACE,
    NominalTrajectory,
    Transcription,
    Weights,
)
from npend_gym.rl.evaluation.settings import keywords_of, number_of_steps

GUESSES = "waves", "mpc"
DURATIONS = 6.0, 12.0, 24.0  # s, of trajectories that are tried, one after the other
_LONGER = 5.0 / 3.0  # rail on which MPC guesses where its motions on the real one lead to no plan


def planned_swing_up(
    config: EnvConfig,
    seconds: float | None = None,
    *,
    settle: float = 0.0,
    tries: int = 4,
    guess: str | None = None,
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    cart_position: float = 0.0,
    speed_weight: float = 0.0,
    change_weight: float = 0.0,
    slow_from: float = 0.0,
) -> PlannedTransition:
    """Plan swing-ups and return the one that is least sensitive to deviations at its start.

    It is `planned_transition` from hanging to upright, which explains the arguments. By default the
    guesses are "waves"; about half of them lead to a trajectory. If none does, the guesses are
    "mpc"; nearly all of these do, with up to six rods. The modes "balance" and "calm", whose
    episodes begin elsewhere, raise a ValueError.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import evaluate, planned_swing_up
    >>> plan = planned_swing_up(EnvConfig(mode="swingup", n=1), 3.0, tries=1, guess="mpc")
    >>> evaluate(plan, {"mode": "swingup", "n": 1}, episodes=4).success_rate
    1.0
    """
    check_config(config)
    if isinstance(config.mode, (Balance, Calm)):
        stands = isinstance(config.mode, Balance)
        others = "lqr(config) or MPC(config)" if stands else "modal_damping(config)"
        raise ValueError(
            "config must be of a mode whose episodes begin hanging, such as "
            f'mode="swingup", got "{config.mode.name}": {others} succeeds there, and '
            "planned_transition(config, 0.0, np.pi) plans a swing-up in any mode"
        )
    return _best_plan(
        config, np.zeros(config.n), np.full(config.n, np.pi), GUESSES if guess is None else guess,
        seconds, settle, tries, seed, progress, cart_position,
        Weights(speed_weight, change_weight, slow_from),
    )  # fmt: skip


def planned_transition(
    config: EnvConfig,
    start: ArrayLike,
    goal: ArrayLike,
    seconds: float | None = None,
    *,
    settle: float = 0.0,
    tries: int = 4,
    guess: str | None = None,
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    cart_position: float = 0.0,
    speed_weight: float = 0.0,
    change_weight: float = 0.0,
    slow_from: float = 0.0,
) -> PlannedTransition:
    """Plan motions between equilibria; return the one least sensitive to deviations at its start.

    Parameters
    ----------
    config : EnvConfig
        Settings of the environment, ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``. The
        trajectory has the steps of the environment, with dry friction. The gains treat friction as
        `lqr` does about the goal.
    start, goal : float or array_like, shape (n,)
        Two different equilibria: 0 for a rod that hangs, pi for one that stands [rad]. They may be
        the same where a cart moves.
    seconds : float, optional
        Duration of the trajectory; by default 6 s, or 12 s or 24 s if no shorter one is found.
    settle : float
        Time [s] for which LQR about the start calms the chain before the trajectory begins.
    tries : int
        Number of first guesses, drawn from `seed`.
    guess : str, optional
        "waves", random paths that are no motions; or "mpc", transitions by `MPC` from near the
        start, which take longer, but lead to a trajectory more often. On a cart, if none of these
        does, `MPC` guesses again on a longer rail. By default "mpc", and "waves" if "mpc" finds
        nothing.
    seed : int
        Seed of the guesses.
    progress : callable
        May wrap the iteration over the guesses, as tqdm does.
    cart_position : float
        Where a cart ends [m]; it begins in the middle of its rail.
    speed_weight, change_weight : float
        A plan has little of the sum over steps of action^2 + (speed_weight [s/rad] speed of the
        joints)^2 + (change_weight [s] rate of the action)^2: for slow joints and smooth torques.
    slow_from : float
        Time [s] from which the speed of the joints, and of a cart, counts: for a quick swing-up
        that is slow near its end.

    Returns
    -------
    PlannedTransition

    Raises
    ------
    RuntimeError
        If none of the guesses leads to a trajectory.
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import planned_transition
    >>> config = EnvConfig(mode="transition", n=1)
    >>> plan = planned_transition(config, 0.0, np.pi, 3.0, tries=1)
    >>> plan.nominal.states[-1].round(3).tolist()  # the angle, and its rate
    [3.142, 0.0]
    """
    check_config(config)
    begin, end = (
        np.where(
            checked_equilibrium(name, _checks.vector(name, angles, config.n)) < 0.0, np.pi, 0.0
        )
        for name, angles in (("start", start), ("goal", goal))
    )
    return _best_plan(
        config, begin, end, GUESSES[::-1] if guess is None else guess,
        seconds, settle, tries, seed, progress, cart_position,
        Weights(speed_weight, change_weight, slow_from),
    )  # fmt: skip


def _best_plan(
    config: EnvConfig,
    begin: FloatArray,
    end: FloatArray,
    guess: str | Sequence[str],  # several: one after the other, until there is a plan
    seconds: float | None,
    settle: float,
    tries: int,
    seed: int,
    progress: Callable[[Iterable[int]], Iterable[int]],
    cart_position: float,
    weights: Weights,
) -> PlannedTransition:
    """Return the plan of `planned_transition`; start and goal are exact, (n,)."""
    for name, value in zip(("speed_weight", "change_weight", "slow_from"), weights, strict=True):
        _checks.nonnegative_number(name, value)
    place = checked_place(config, cart_position, MAX_PLACE)
    if np.array_equal(begin, end) and place == 0.0:
        cart = ", or cart_position another place" if config.has_cart else ""
        raise ValueError(f"goal must be another equilibrium than start, got {end.tolist()}{cart}")
    durations = DURATIONS if seconds is None else (seconds,)
    settle = _checks.nonnegative_number("settle", settle)
    weightless = config.chain.gravity == 0.0
    if not isinstance(guess, str):
        guesses = [each for each in guess if each == "waves" or not weightless]
    elif _checks.choice("guess", guess, GUESSES) == "mpc" and weightless:
        raise ValueError('guess must be "waves" without gravity, where MPC knows no horizon')
    else:
        guesses = [guess]
    tries, seed = _checks.count("tries", tries), _checks.count("seed", seed, low=0)
    steps = [number_of_steps("seconds", each, config.dt) for each in durations]
    for count, kind in itertools.product(steps, guesses):
        problem = Transcription(config, count, begin, end, place, weights)
        for drawn in _guesses(problem, kind, tries, seed):
            nominals = [problem.solve(*drawn[attempt]) for attempt in progress(range(len(drawn)))]
            found = [track(config, each, settle) for each in nominals if each is not None]
            if found:
                return min(found, key=lambda controller: controller.sensitivity)
    times = " or ".join(f"{count * config.dt:g}" for count in steps)
    raise RuntimeError(
        f"no trajectory of {times} s was found in {tries} tries: "
        "give it more seconds, tries or torque, or another seed; the limits are "
        f"{config.action_limits.tolist()} [N m, or N of a cart]"
    )


def _guesses(
    problem: Transcription, kind: str, tries: int, seed: int
) -> Iterator[list[tuple[FloatArray, FloatArray]]]:
    """Return first guesses of a kind, and then others where these lead to no plan."""
    config, generators = problem.model.config, [default_rng([seed, k]) for k in range(tries)]
    if kind == "waves":
        yield [problem.wavy_guess(rng) for rng in generators]
        return
    near = np.stack([rng.uniform(-START, START, config.state_size) for rng in generators])
    # MPC may never stand up on a short rail; its motion on a longer one can be made to fit
    rails = [config]
    if config.rail is not None:
        longer: dict[str, Any] = keywords_of(config) | {"rail": _LONGER * config.rail}
        rails.append(EnvConfig(**longer))
    for on_rail in rails:
        motions = mpc_motions(
            on_rail, near + problem.begin, problem.goal, problem.steps, problem.place
        )
        yield [problem.unknowns(*motion) for motion in motions]


def mpc_motions(
    config: EnvConfig, states: FloatArray, goal: FloatArray, steps: int, place: float = 0.0
) -> list[NominalTrajectory]:
    """Return transitions by `MPC` from these states, (B, 2c), without those that diverge."""
    step, controller = StepModel(config), MPC(config, goal, cart_position=place)
    motions, actions = [states], list[FloatArray]()
    try:
        for k in range(steps):
            actions.append(controller.plan(motions[-1], np.full(len(states), k * config.dt)))
            motions.append(step(motions[-1], actions[-1]))
    except FloatingPointError:  # one of them diverges
        alone = np.split(states, len(states)) if len(states) > 1 else []
        return [motion for one in alone for motion in mpc_motions(config, one, goal, steps, place)]
    pairs = zip(np.stack(motions, axis=1), np.stack(actions, axis=1), strict=True)
    return [NominalTrajectory(*pair) for pair in pairs]


def replanned(
    config: EnvConfig, near: NominalTrajectory, like: NominalTrajectory
) -> PlannedTransition | None:
    """Return a plan between the equilibria of a motion nearby, or None where that leads to none.

    Of such plans it is one whose actions are most like those of the motion `like`.
    """
    (first, _), (last, place) = (rest_of(config, near.states[k]) for k in (0, -1))
    problem = Transcription(config, len(near.actions), first, last, place)
    nominal = problem.solve(*problem.unknowns(*near), like=like)
    return None if nominal is None else track(config, nominal, 0.0)
