"""The built-in studies of `npend campaign`, beside the release: what each does in one trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _files, chaos, identification, rl
from npend_gym.chain import as_chain
from npend_gym.experiments.chains import released_chain
from npend_gym.experiments.release import starts
from npend_gym.rl.policies.shipped import find_policy, policy_path
from npend_gym.rl.training.tasks import env_of_task

Row = dict[str, Any]


def evaluate(
    *,
    seed: int,
    policy: str | None = None,
    controller: str | None = None,
    task: str = "swingup-2",
    episodes: int = 100,
    **env: Any,
) -> Row:
    """Evaluate a policy, or a `controller` of a `task`, in held-out episodes.

    Other parameters are keywords of the environment. Trials share no episode.
    """
    model, played, about = _chosen(policy, controller, task, env)
    first = rl.HELD_OUT + seed * episodes
    return about | rl.evaluate(model, played, episodes=episodes, seed=first).as_row()


def robustness(
    *,
    seed: int,
    policy: str | None = None,
    controller: str | None = None,
    task: str = "swingup-2",
    values: int = 21,
    repetitions: int = 10,
    seconds: float = 10.0,
    **env: Any,
) -> list[Row]:
    """Return a row for every value of every criterion that a policy survives, or does not."""
    model, played, about = _chosen(policy, controller, task, env)
    first = rl.HELD_OUT + 100_000 * seed  # trials share no rollout
    found = rl.robustness(
        model, played, seed=first, values=values, repetitions=repetitions, seconds=seconds
    )
    return [
        about | {"criterion": name, "parameter": parameter, "value": value, "unit": each.unit}
        | {"survived": survived, "scored": each.scored}
        for name, each in found.outcomes.items()
        for parameter, value, survived in zip(
            each.parameters, each.values.tolist(), each.survived.tolist(), strict=True
        )
    ]  # fmt: skip


def _chosen(
    policy: str | None, controller: str | None, task: str, env: Mapping[str, Any]
) -> tuple[Any, dict[str, Any], Row]:
    """Return a model, the keywords of its environment, and what a row says of the model."""
    if (policy is None) == (controller is None):
        raise ValueError("give either a policy, or a controller with its task")
    if controller is not None:
        keywords = {**env_of_task(task), **env}
        return rl.reference_controller(controller, keywords), keywords, {}
    loaded = find_policy(str(policy))
    digest = _files.sha256(Path(policy_path(str(policy))))
    return loaded, {**loaded.env, **env}, {"policy_sha256": digest}


def train(
    *,
    seed: int,
    task: str,
    algorithm: str = "shac",
    episodes: int = 100,
    env: Mapping[str, Any] | None = None,
    **settings: Any,
) -> Row:
    """Train a policy and evaluate it; other parameters are settings of the algorithm."""
    from npend_gym.rl.training.tasks import row_of
    from npend_gym.rl.training.trainers import trainer  # PyTorch, an extra

    chosen = trainer(algorithm)
    using = chosen.settings_of(task, seed=seed, **settings)
    using = replace(using, env={**using.env, **(env or {})})
    policy, curve = chosen.train(using)
    return {"steps": curve[-1]["steps"], **row_of(policy, using, episodes=episodes)}


def lyapunov(
    *,
    seed: int,
    theta: float | Sequence[float],
    omega: float | Sequence[float] = 0.0,
    duration: float = 100.0,
    spread: float = 0.0,
    chain: Any = None,
    n: int = 2,
    **of_chain: Any,
) -> Row:
    """Return the largest exponent [1/s] of a motion, with its error.

    Every trial adds to all angles one draw from [0, spread) [rad]. The chain is `chain`, or `n`
    rods with masses, lengths, gravity and damping.
    """
    used = released_chain(n, **of_chain) if chain is None else as_chain(chain)
    drawn = float(starts(seed, 0, 1, 0.0, spread)[0])
    found = chaos.largest_lyapunov(used, np.asarray(theta) + drawn, omega, duration=duration)
    row = {"exponent": found.exponent, "error": found.error, "chaotic": bool(found.chaotic)}
    return {"drawn_rad": drawn, **row}


def identify(
    *,
    seed: int,
    recording: str,
    chain: Any,
    noise: float = 0.0,
    fit: Sequence[str] | None = None,
    segment: float | None = None,
    held_out: float = 0.25,
) -> list[Row]:
    """Return a row for every parameter of a chain that is fitted to a recorded motion.

    Every trial adds normal noise [rad] of its own to the angles.
    """
    motion = identification.read_motion(recording)
    drawn = np.random.Generator(np.random.Philox(seed)).normal(size=motion.theta.shape)
    found = identification.identify(
        motion.times, motion.theta + noise * drawn, motion.torque, chain=as_chain(chain),
        piece=motion.piece, fit=fit, segment=segment, held_out=held_out, position=motion.position,
    )  # fmt: skip
    about = {"rmse_rad": found.fitted_rmse, "held_out_rmse_rad": found.held_out_rmse}
    return [
        {"parameter": name, "unit": unit, "value": value, "standard_error": error, **about}
        for name, unit, value, error in found.rows()
    ]
