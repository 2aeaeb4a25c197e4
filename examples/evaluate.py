"""Evaluate a policy, a controller or a run of `train_sb3.py` in held-out episodes, and film it.

Run it with `python examples/evaluate.py --pretrained swingup-2 --video swingup-2.gif`. Without a
film, `npend evaluate swingup-2` does the same.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from npend_gym.envs import ENV_ID
from npend_gym.report import evaluation_text, prepare_file
from npend_gym.rl import (
    CONTROLLERS,
    HELD_OUT,
    Controller,
    Model,
    as_controller,
    evaluate,
    find_policy,
    pretrained_names,
    reference_controller,
    setting_of,
)
from npend_gym.rl.training import env_of_task, evaluation_env


def chosen(arguments: argparse.Namespace) -> tuple[Controller | Model, dict[str, Any]]:
    """Return the policy, model or controller asked for and the keywords of its environment."""
    if arguments.run:
        import train_sb3

        model, config = train_sb3.load_run(arguments.run, trust=arguments.trust)
        arguments.env_id, settings = train_sb3.section(config)
        return model, evaluation_env(settings.get("env_kwargs", {}))
    if arguments.controller:
        keywords = env_of_task(arguments.task or "swingup-2")
        progress = partial(tqdm, desc="plans", leave=False, disable=None)
        return reference_controller(arguments.controller, keywords, progress), keywords
    policy = find_policy(str(arguments.policy or arguments.pretrained), trust=arguments.trust)
    return policy, policy.env


def film(
    controller: Controller | Model,
    keywords: dict[str, Any],
    seed: int,
    seconds: float,
    path: Path,
    *,
    env_id: str = ENV_ID,
) -> None:
    """Write the start of an episode as .mp4 or .gif, or 12 frames of it as .png."""
    import imageio.v3 as imageio

    env: Any = gym.make(env_id, render_mode="rgb_array", **keywords)
    acts = as_controller(controller, env.unwrapped.config)
    observation, info = env.reset(seed=seed)
    frames, done = [env.render()], False
    skip = max(1, round(env.metadata["render_fps"] / 25))
    while not done:
        goals = isinstance(observation, dict)  # of a `goal_env`
        shown = {k: v[None] for k, v in observation.items()} if goals else observation[None]
        batch = {key: np.asarray(value)[None] for key, value in info.items()}
        action = np.asarray(acts(shown, batch))[0].astype(env.action_space.dtype)
        observation, _, terminated, truncated, info = env.step(action)
        done = terminated or truncated or info["time"] >= seconds
        if round(info["time"] / env.unwrapped.config.dt) % skip == 0:
            frames.append(env.render())
    env.close()
    if path.suffix == ".png":
        shown = np.linspace(0, len(frames) - 1, 12).astype(int)
        small = [frames[k][::2, ::2] for k in shown]
        imageio.imwrite(path, np.vstack([np.hstack(small[:6]), np.hstack(small[6:])]))
        return
    rate = env.metadata["render_fps"] / skip
    timing = {"duration": 1000.0 / rate, "loop": 0} if path.suffix == ".gif" else {"fps": rate}
    imageio.imwrite(path, np.stack(frames), **timing)


def setting(text: str) -> tuple[str, Any]:
    """Return name and value of NAME=VALUE: a value of JSON, or else a text."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text}")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def main() -> None:
    """Evaluate what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--pretrained", choices=pretrained_names(), help="comes with the package")
    what.add_argument("--policy", type=Path, help=".safetensors that a training script has written")
    what.add_argument("--run", type=Path, help="folder that train_sb3.py has written")
    what.add_argument("--controller", choices=CONTROLLERS)
    parser.add_argument("--task", help='of --controller, as in "balance-3" ("swingup-2")')
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--steps", type=int, help="of an episode, in place of the default")
    parser.add_argument("--seed", type=int, default=HELD_OUT, help="of the first episode")
    parser.add_argument("--video", type=Path, help="of the first episode: .mp4, .gif or .png")
    parser.add_argument("--seconds", type=float, default=15.0, help="length of the film")
    text = f'environment, "npend/SwingUp-v1" say ({ENV_ID}); --run has its own'
    parser.add_argument("--env-id", help=text)
    text = "a keyword of the environment, such as damping=0.05; may be repeated"
    parser.add_argument("--env", type=setting, action="append", default=[], help=text)
    parser.add_argument("--trust", action="store_true", help="import what a file names")
    arguments = parser.parse_args()
    if arguments.steps is not None and arguments.steps < 1:
        parser.error(f"--steps must be at least 1, got {arguments.steps}")
    if arguments.task and not arguments.controller:
        parser.error("--task is for --controller: a policy has an environment of its own")
    if arguments.env_id and arguments.run:
        parser.error("--env-id is not for --run, which has an environment of its own")
    if arguments.video:
        prepare_file(arguments.video, [".mp4", ".gif", ".png"], "--video")
    arguments.env_id = arguments.env_id or ENV_ID
    controller, keywords = chosen(arguments)
    keywords = keywords | dict(arguments.env)
    if arguments.steps:
        keywords = keywords | {"max_episode_steps": arguments.steps}
    print(f"{arguments.env_id} {keywords}")
    evaluated = keywords | {"id": arguments.env_id}
    evaluation = evaluate(controller, evaluated, episodes=arguments.episodes, seed=arguments.seed)
    print(evaluation_text(evaluation.as_row(), setting_of(evaluated).reward_threshold))
    if arguments.video:
        seed, seconds, path = arguments.seed, arguments.seconds, arguments.video
        film(controller, keywords, seed, seconds, path, env_id=arguments.env_id)
        print(f"written: {arguments.video}")


if __name__ == "__main__":
    main()
