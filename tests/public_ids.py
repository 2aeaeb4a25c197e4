"""What the public ids are: spaces, starts, and what a few steps show, in tests/public_ids.json.

`python tests/public_ids.py` adds ids that the file lacks. It changes none that is there: who
changes the reward, the success, the start or the observation of an id registers the next version,
such as "npend/SwingUp-v2", and leaves the old one as it is. See docs/howto/benchmark.md.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import npend_gym  # noqa: F401  registers the environments
from npend_gym.envs import Quantities
from npend_gym.envs.registration import TASKS

FILE = Path(__file__).with_suffix(".json")
STEPS, DIGITS, COUNT = 8, 5, 200
STARTS = {  # seed, and angles from upright [rad] where a task would start elsewhere
    "seed 0": (0, None), "seed 1000000": (1_000_000, None), "near upright": (0, 0.08),
}  # fmt: skip


def described(env_id: str) -> dict[str, Any]:
    """Return what an id is, by its default keywords: numbers rounded, so that any CPU agrees."""
    env = gym.make(env_id)
    said: dict[str, Any] = {
        "observation_space": str(env.observation_space),
        "action_space": str(env.action_space),
        "max_episode_steps": env.spec.max_episode_steps,
        "reward_threshold": env.spec.reward_threshold,
        "dt": env.unwrapped.config.dt,
    }
    n = env.unwrapped.config.n
    said["success"] = success_of(env.unwrapped.config)
    discrete = isinstance(env.action_space, gym.spaces.Discrete)
    for name, (seed, lean) in STARTS.items():
        standing = None if lean is None else {"theta": np.pi - lean * (1.0 + np.arange(n))}
        shown = [env.reset(seed=seed, options=standing)[0]]
        rewards, ends = list[float](), list[bool]()
        for k in range(STEPS):
            action = 0 if discrete else np.full(env.action_space.shape, 0.5 - 0.3 * k, np.float32)
            observation, reward, over, *_ = env.step(action)
            shown.append(observation)
            rewards.append(round(float(reward), DIGITS))
            ends.append(over)
        said[name] = {
            "observations": np.round(np.float64(shown), DIGITS).tolist(),
            "rewards": rewards,
            "terminated": ends,
        }
    env.close()
    return said


def success_of(config: Any) -> str:
    """Return for how long the goal must hold, and whether drawn quantities meet it, as 0 or 1."""
    rng = np.random.default_rng(0)
    names = Quantities.__annotations__
    drawn = {name: 3.0 * rng.random(COUNT) ** 4 for name in names}  # many are small
    drawn |= {name: 1.0 - drawn[name] for name in ("height", "tip", "uprightness")}
    turned, drawn["omega"] = rng.normal(size=(2, COUNT, config.n))
    drawn["theta"] = np.pi + turned
    met = np.broadcast_to(config.mode.achieved(Quantities(**drawn)), COUNT)
    return f"{config.mode.hold:g} s: " + "".join("01"[bool(each)] for each in met)


def main() -> None:
    """Add what is missing."""
    known = json.loads(FILE.read_text("utf-8")) if FILE.exists() else {}
    added = {env_id: described(env_id) for env_id in TASKS if env_id not in known}
    lines = (
        f"{json.dumps(env_id)}: {json.dumps(said)}" for env_id, said in (known | added).items()
    )
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(f"{FILE}: added {', '.join(added) or 'nothing'}")


if __name__ == "__main__":
    main()
