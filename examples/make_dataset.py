"""Data sets of episodes for offline learning, in the format of Minari.

    python examples/make_dataset.py medium --n 3
    python examples/clone_behaviour.py npend/swingup-3/medium-v0

The kinds are "random", "medium" and "expert" swing-ups, free releases, and "transitions" between
all equilibria. "Medium" and "expert" take the policy of the package for n rods. It needs
`pip install "minari[create]" pyarrow`, which keeps what is made in a folder of the user, or in that
of the variable MINARI_DATASETS_PATH. An episode that is played again from its seed, in the
environment that the data set recovers, has the same observations, to the last bit.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import npend_gym  # noqa: F401  registers the environments
from npend_gym import __version__
from npend_gym.envs import ENV_ID
from npend_gym.rl import Controller, PlannedTransitions, Policy, planned_transitions

KINDS = "random", "medium", "expert", "release", "transitions"
NAMES = {"release": "npend/release-{n}/free-v0", "transitions": "npend/transition-{n}/plans-v0"}
# Deviation of the noise on the actions of "medium", under which a part of the episodes fails
MEDIUM = {2: 0.3, 3: 0.15, 4: 0.08}


class Source(NamedTuple):
    """Where the actions of a data set come from."""

    controller: Controller
    env: dict[str, Any]  # keywords of the environment
    noise: float = 0.0  # standard deviation added to the actions
    description: str = ""


def source_of(kind: str, n: int, plans: Path | None, seed: int) -> Source:
    """Return the source of a kind of data set, for chains of n rods."""
    if kind == "release":
        env = {"n": n, "mode": "passive", "spread": 0.5}
        waits = lambda observation, info: np.zeros(len(observation), np.int64)  # noqa: E731, ARG005
        return Source(waits, env, 0.0, "Free releases from rest.")
    if kind == "transitions":
        env = {"n": n, "mode": "transition", "max_episode_steps": 400}
        config = gym.make(ENV_ID, **env).unwrapped.config
        if plans is not None and plans.exists():
            planned = PlannedTransitions.load(plans, config)
        else:
            planned = planned_transitions(config)
            if plans is not None:
                planned.save(plans)
        text = "Planned transitions from any equilibrium to any other, tracked by feedback."
        return Source(planned, env, 0.0, text)
    if kind == "random":
        env = {"n": n, "mode": "swingup", "observation": "sincos"}
        rng = np.random.default_rng(seed)
        draws = lambda observation, info: rng.uniform(-1.0, 1.0, (len(observation), 1))  # noqa: E731, ARG005
        return Source(draws, env, 0.0, "Swing-ups under random torques.")
    expert = Policy.pretrained(f"swingup-{n}")
    noise = MEDIUM.get(n, 0.1) if kind == "medium" else 0.0
    text = f"Swing-ups by the policy swingup-{n}, with noise of {noise:g} on its actions."
    return Source(expert, expert.env, noise, text)


def episodes_of(source: Source, count: int, seed: int) -> tuple[list[dict[str, Any]], float]:
    """Play episodes side by side; return the arrays of each, and the share that succeeded."""
    envs: Any = gym.make_vec(ENV_ID, num_envs=count, **source.env)
    rng = np.random.default_rng(seed)
    observation, info = envs.reset(seed=seed)
    arrays: dict[str, list[Any]] = {"observations": [observation]}
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
        now = (ends == 0) & (terminated | truncated)
        ends[now], success[now] = len(arrays["actions"]), info["success"][now]
    stacked = {name: np.stack(values, axis=1) for name, values in arrays.items()}
    found = [
        {name: values[lane, : end + (name == "observations")] for name, values in stacked.items()}
        | {"seed": seed + lane}
        for lane, end in enumerate(ends)
    ]
    return found, float(success.mean())


def main() -> None:
    """Play the episodes, and keep them as a data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--n", type=int, default=2, help="number of rods (default 2)")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first episode")
    parser.add_argument("--plans", type=Path, help=".npz of the plans, written where it is missing")
    arguments = parser.parse_args()
    import minari  # after --help, which does not need it
    from minari.data_collector.episode_buffer import EpisodeBuffer

    name = NAMES.get(arguments.kind, "npend/swingup-{n}/{kind}-v0").format(**vars(arguments))
    if name in minari.list_local_datasets():
        parser.error(f"{name} exists: `minari delete {name}` removes it")
    if arguments.plans:
        arguments.plans.parent.mkdir(parents=True, exist_ok=True)
    source = source_of(arguments.kind, arguments.n, arguments.plans, arguments.seed)
    episodes, success = episodes_of(source, arguments.episodes, arguments.seed)
    returns = [episode["rewards"].sum() for episode in episodes]
    minari.create_dataset_from_buffers(
        name,
        [EpisodeBuffer(id=k, **episode) for k, episode in enumerate(episodes)],
        env=gym.make(ENV_ID, **source.env).spec,
        algorithm_name=type(source.controller).__name__,
        author="npend_gym",
        description=f"{source.description} npend_gym {__version__}, seeds from {arguments.seed}, "
        f"{success:.0%} succeeded, mean return {np.mean(returns):.0f}.",
        num_episodes_average_score=1,
        data_format="arrow",
    )
    steps = sum(len(episode["actions"]) for episode in episodes)
    print(f"{name}: {len(episodes)} episodes, {steps} steps, "
          f"{success:.0%} succeeded, mean return {np.mean(returns):.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
