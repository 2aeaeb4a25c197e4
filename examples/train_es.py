"""Evolution strategies: a linear policy from the returns of whole episodes, without gradients.

Run it with `python examples/train_es.py calm-20`: it writes `calm-20.npz`, a policy of plain
numbers for `examples/evaluate.py`, and `calm-20.csv`, its learning curve. Salimans, Ho, Chen,
Sidor, Sutskever, arXiv:1703.03864, with all candidates side by side in one vector environment.

A long chain is slow and its motor strong: noise that is new in every step, as in PPO, sets the
rods whipping and hides what an action does to the energy seconds later. Noise on the policy acts
alike all episode long. The mirror image of a chain asks for the opposite action, so the weights of
cosines stay zero: a third fewer to find, and no torque is left at rest.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import npend_gym
from npend_gym.report.outputs import write_csv
from npend_gym.rl.policies import Policy


@dataclass(frozen=True)
class Settings:
    """What a training run is made of; every result is a function of this."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords of gym.make_vec
    seed: int = 0
    updates: int = 60
    pairs: int = 32  # candidates in an update, each with its mirror image
    steps: int = 1000  # of an episode
    noise: float = 0.02  # of the candidates' weights
    rate: float = 0.02  # Adam's, falls linearly to zero


TASKS: dict[str, dict[str, Any]] = {
    "calm-5": {},
    "calm-10": {},
    "calm-20": {"updates": 80, "noise": 0.01, "rate": 0.01},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "calm-20"."""
    mode, n = task.rsplit("-", 1)
    env = {"n": int(n), "mode": mode, "observation": "sincos"}
    return Settings(env=env, **(TASKS.get(task, {}) | changes))


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, list[dict[str, Any]]]:
    """Return the trained policy and its learning curve, a row for every tenth update."""
    rng = np.random.default_rng(settings.seed)
    envs = gym.make_vec(
        "NPendulum-v0", num_envs=2 * settings.pairs, max_episode_steps=None, **settings.env
    )
    weights = np.zeros(envs.single_observation_space.shape[0])
    odd = np.repeat([1.0, 0.0, 1.0], weights.size // 3)  # sines, cosines, speeds
    slope, square = np.zeros((2, weights.size))  # running means of Adam
    curve: list[dict[str, Any]] = []
    begun = time.perf_counter()
    for update in tqdm(range(1, settings.updates + 1), progress, disable=None, unit="update"):
        tried = odd * rng.normal(size=(settings.pairs, weights.size))
        noise = settings.noise * np.concatenate([tried, -tried])
        # all begin alike; these seeds are for training, those from 10^6 on for evaluation
        start = 1000 * settings.seed + update
        returns, success = play(envs, weights + noise, settings.steps, start)
        ranks = returns.argsort().argsort() / (returns.size - 1)
        gain = (ranks[: settings.pairs] - ranks[settings.pairs :]) @ tried / settings.pairs
        slope = 0.9 * slope + 0.1 * gain
        square = 0.99 * square + 0.01 * gain**2
        step = slope / (1.0 - 0.9**update) / (np.sqrt(square / (1.0 - 0.99**update)) + 1e-8)
        weights += settings.rate * (1.0 - (update - 1) / settings.updates) * step
        if update % 10 == 0 or update == settings.updates:
            curve.append({
                "steps": update * returns.size * settings.steps,
                "seconds": round(time.perf_counter() - begun, 2),
                "return": round(float(returns.mean()), 4),
                "success": round(float(success.mean()), 4),
                "spread": settings.noise,
            })  # fmt: skip
    envs.close()
    return as_policy(weights, settings, curve[-1]), curve


def play(
    envs: gym.vector.VectorEnv, weights: np.ndarray, steps: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return returns and successes of an episode of each candidate, (candidates,)."""
    observation, info = envs.reset(seed=[seed] * len(weights))
    returns = np.zeros(len(weights))
    for _ in range(steps):
        action = np.einsum("bk,bk->b", observation, weights).clip(-1.0, 1.0)
        observation, reward, _, _, info = envs.step(action[:, None])
        returns += reward
    return returns, info["success"]


def as_policy(weights: np.ndarray, settings: Settings, last: dict[str, Any]) -> Policy:
    """Return the linear policy as plain arrays, with where it comes from."""
    return Policy(
        scale=np.ones(weights.size, np.float32),
        weights=[weights[None].astype(np.float32)],
        biases=[np.zeros(1, np.float32)],
        provenance={
            "trained_by": "examples/train_es.py",
            "npend_gym": npend_gym.__version__,
            "numpy": np.__version__,
            "env": settings.env,
            "settings": asdict(settings),
            "training": last,
        },
    )


def main() -> None:
    """Train one policy and write it down."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help='mode and number of rods, as in "calm-20"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--updates", type=int)
    parser.add_argument("--out", type=Path, default=Path())
    arguments = parser.parse_args()
    changes = {} if arguments.updates is None else {"updates": arguments.updates}
    settings = settings_of(arguments.task, seed=arguments.seed, **changes)
    policy, curve = train(settings, arguments.task)
    arguments.out.mkdir(parents=True, exist_ok=True)
    policy.save(arguments.out / f"{arguments.task}.npz")
    write_csv(arguments.out / f"{arguments.task}.csv", curve)
    print(f"{arguments.task}: {curve[-1]}")


if __name__ == "__main__":
    main()
