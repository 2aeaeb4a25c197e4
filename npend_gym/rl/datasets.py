"""Data sets of episodes for offline learning, in the format of Minari."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._progress import bar
from npend_gym._version import __version__
from npend_gym.envs.modes import MODES
from npend_gym.envs.registration import ENV_ID
from npend_gym.rl.benchmarking.readers import RandomActions
from npend_gym.rl.controllers.references import reference_controller
from npend_gym.rl.controllers.transitions import PlannedTransitions, planned_transitions
from npend_gym.rl.evaluation.rollouts import Controller, forget
from npend_gym.rl.evaluation.seeds import VALIDATION
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.files import pretrained_names
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.tasks import env_of_task

KINDS = "random", "medium", "expert", "robust", "plans", "free"
# Deviation of the noise on the actions of "medium", under which a part of the swing-ups fails
_MEDIUM = {"swingup-2": 0.3, "swingup-3": 0.15, "swingup-4": 0.08}
_STATES = "theta", "omega", "cart_position", "cart_velocity", "context", "success"  # of info
_REPLAY = "reset(seed) of the recovered environment and the actions give it again, bit for bit"


class Source(NamedTuple):
    """Where the actions of a data set come from."""

    controller: Controller
    env: dict[str, Any]  # keywords of NPendulum-v0
    noise: float = 0.0  # standard deviation added to the actions
    description: str = ""


def source_of(
    task: str,
    kind: str,
    *,
    seed: int = 0,
    plans: Path | None = None,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Source:
    """Return the source of the actions of a kind of data set; see `npend dataset`."""
    _checks.choice("kind", kind, KINDS)
    if plans is not None and (kind != "plans" or not task.startswith("transition")):
        raise ValueError(
            "plans must be left out but for the kind 'plans' of a transition, got the kind "
            f"{kind!r} of {task!r}"
        )
    mode, _, n = task.partition("-")
    if mode == "release" and n.isdecimal() and int(n) > 0:
        if kind != "free":
            raise ValueError(f'kind must be "free" for {task}, which has no motor; got {kind!r}')
        env: dict[str, Any] = {"n": int(n), "mode": "passive", "spread": 0.5}
        return Source(_wait, env, 0.0, "Free releases from rest.")
    env = env_of_task(task)
    if MODES[env["mode"]].torque_share == 0.0 or kind == "free":
        raise ValueError(f'task must be like "release-5" for the kind "free", got {task!r}')
    if kind == "plans":
        return _planned(env, plans, progress)
    if kind == "random":
        return Source(RandomActions(env, seed), env, 0.0, "Random torques.")
    name = f"{task}-robust" if kind == "robust" else task
    if name not in pretrained_names():
        known = [
            each for each in pretrained_names() if each.endswith("-robust") == (kind == "robust")
        ]
        shown = ", ".join(each.removesuffix("-robust") for each in known)
        raise ValueError(f"task must be one of {shown} for the kind {kind!r}, got {task!r}")
    policy = Policy.pretrained(name)
    env = dict(policy.env)
    if kind == "robust":  # a new chain in every episode
        env["randomize"] = env_of_task(name)["randomize"]
    noise = _MEDIUM.get(task, 0.1) if kind == "medium" else 0.0
    return Source(policy, env, noise, f"By the policy {name}, with noise of {noise:g} on actions.")


def _wait(observation: Any, info: dict[str, Any]) -> Any:
    del info
    return np.zeros(len(observation), np.int64)


def _planned(
    env: dict[str, Any],
    plans: Path | None,
    progress: Callable[[Iterable[Any]], Iterable[Any]],
) -> Source:
    """Return the plans of a task, tracked by feedback."""
    text = "Planned motions, tracked by feedback."
    if env["mode"] not in ("swingup", "transition"):
        raise ValueError(
            "task must be a swing-up or a transition for the kind 'plans', such as swingup-2; got "
            f"the mode {env['mode']!r}"
        )
    if not MODES[env["mode"]].has_goals:
        return Source(reference_controller("plan", env, progress), env, 0.0, text)
    env |= {"observation": "angles", "max_episode_steps": 400}
    config = setting_of(env).config
    if plans is not None and plans.exists():
        return Source(PlannedTransitions.load(plans, config), env, 0.0, text)
    planned = planned_transitions(config, progress=progress)
    if plans is not None:
        plans.parent.mkdir(parents=True, exist_ok=True)
        planned.save(plans)
    return Source(planned, env, 0.0, text)


def episodes_of(source: Source, count: int, seed: int) -> tuple[list[dict[str, Any]], float]:
    """Play episodes side by side; return the arrays of each, and the share that succeeded.

    The episodes have the seeds `seed`, `seed` + 1 and so on. "infos" has the exact state before
    each step, and at the end.
    """
    envs: Any = gym.make_vec(ENV_ID, num_envs=count, **source.env)
    rng = np.random.default_rng(seed)
    observation, info = envs.reset(seed=seed)
    forget(source.controller, count)
    arrays: dict[str, list[Any]] = {"observations": [observation]}
    states = {name: [info[name].copy()] for name in _STATES if name in info}
    ends, success = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    while (ends == 0).any():
        action = np.asarray(source.controller(observation, info))
        if source.noise > 0.0:
            action = action + source.noise * rng.normal(size=action.shape)
        if action.dtype.kind == "f":
            action = action.clip(-1.0, 1.0).astype(np.float32)
        observation, reward, terminated, truncated, info = envs.step(action)
        step = {"observations": observation, "actions": action, "rewards": reward,
                "terminations": terminated, "truncations": truncated}  # fmt: skip
        for name, value in step.items():
            arrays.setdefault(name, []).append(value)
        for name, kept in states.items():
            kept.append(info[name].copy())
        now = (ends == 0) & (terminated | truncated)
        ends[now], success[now] = len(arrays["actions"]), info["success"][now]
    envs.close()
    stacked = {name: np.stack(values, axis=1) for name, values in arrays.items()}
    shown = {name: np.stack(values, axis=1) for name, values in states.items()}
    found = [
        {name: values[lane, : end + (name == "observations")] for name, values in stacked.items()}
        | {"infos": {name: _kept(values[lane, : end + 1]) for name, values in shown.items()}}
        | {"seed": seed + lane}
        for lane, end in enumerate(ends.tolist())
    ]
    return found, float(success.mean())


def _kept(values: NDArray[Any]) -> Any:
    """Return numbers as Minari reads them back, which fails for arrays of one number a step."""
    return values if values.ndim > 1 else values.tolist()


def write_dataset(
    task: str,
    kind: str = "expert",
    *,
    episodes: int = 100,
    seed: int = 0,
    plans: Path | None = None,
) -> dict[str, Any]:
    """Play episodes and keep them as a data set of Minari, "npend/TASK/KIND-v0".

    Parameters
    ----------
    task : str
        As for `env_of_task`, or "release-5".
    kind : str
        "random"; "expert", the policy of the package; "medium", the expert with noise on its
        actions; "robust", the robust policy with a new chain in every episode; "plans"; or "free"
        for a release.
    episodes, seed : int
        The first episode has this seed, the next ones the following.
    plans : Path, optional
        A .npz file of the plans between equilibria, which is written where it is missing.

    Returns
    -------
    dict
        "id", "episodes", "steps", "success" and "return".

    Raises
    ------
    ValueError
        If the data set exists, or there is no such task or policy.
    ImportError
        If Minari is not installed.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.write_dataset("swingup-1", episodes=0)
    Traceback (most recent call last):
        ...
    ValueError: episodes must be between 1 and 900000, got 0
    """
    _checks.count("episodes", episodes, high=VALIDATION)
    _checks.count("seed", seed, low=0, high=VALIDATION - episodes)
    try:
        minari: Any = import_module("minari")
        buffers: Any = import_module("minari.data_collector.episode_buffer")
    except ImportError as error:
        way_out = 'pip install "minari[create]" pyarrow'
        raise ImportError(f"data sets need minari: install it with {way_out}") from error
    name = f"npend/{task}/{kind}-v0"
    if name in minari.list_local_datasets():
        raise ValueError(f"{name} exists: `minari delete {name}` removes it")
    source = source_of(
        task, kind, seed=seed, plans=plans, progress=partial(bar, unit="plans", leave=False)
    )
    played, success = episodes_of(source, episodes, seed)
    returns = [float(each["rewards"].sum()) for each in played]
    minari.create_dataset_from_buffers(
        name,
        [buffers.EpisodeBuffer(id=k, **each) for k, each in enumerate(played)],
        env=gym.make(ENV_ID, **source.env).spec,
        algorithm_name=type(source.controller).__name__,
        author="npend_gym",
        description=(
            f"{source.description} Task {task} of npend_gym {__version__}, seeds {seed} to "
            f"{seed + episodes - 1}: {success:.0%} succeeded, mean return {np.mean(returns):.0f}. "
            f"`infos` has the exact states. The seed of an episode is kept: {_REPLAY}."
        ),
        num_episodes_average_score=1,
        data_format="arrow",
    )
    return {
        "id": name,
        "episodes": episodes,
        "steps": sum(len(each["actions"]) for each in played),
        "success": success,
        "return": float(np.mean(returns)),
    }
