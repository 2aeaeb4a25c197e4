"""Swing a pendulum up by search: try many futures from the present state, and begin the best one.

    python examples/plan_by_search.py

Nothing is learned, and no equation is used: `get_state` and `set_state` are all that such planners
need, tree search and Go-Explore as well as the random shooting of this one.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np

import npend_gym  # noqa: F401 - registers the environments

CANDIDATES, HORIZON, HOLD = 64, 6, 5  # plans have 6 actions, each held for 5 steps
STEPS = 300


def best_plan(state, plan, futures, rng):
    """Return the plan with the largest return among random ones and changes of the last plan."""
    plans = rng.choice([-1.0, 0.0, 1.0], (CANDIDATES, HORIZON))
    changes = rng.normal(0.0, 0.3, (CANDIDATES // 2, HORIZON))
    changes[0] = 0.0
    plans[: CANDIDATES // 2] = np.clip(plan + changes, -1.0, 1.0)
    futures.set_state(np.repeat(state, CANDIDATES))  # a state fits any sub-environment
    returns = np.zeros(CANDIDATES)
    for action in np.repeat(plans, HOLD, axis=1).T:
        returns += futures.step(action[:, None])[1]
    return plans[returns.argmax()]


def main(seed: int = 0) -> float:
    """Swing up, and return for how long [s] the pendulum has been upright and slow at the end."""
    env = gym.make("npend/SwingUp-v1", n=1)
    futures = gym.make_vec("npend/SwingUp-v1", num_envs=CANDIDATES, n=1, max_episode_steps=None)
    rng, plan, since = np.random.default_rng(seed), np.zeros(HORIZON), 0.0
    _, info = env.reset(seed=seed)
    for k in range(STEPS):
        if k % HOLD == 0:
            plan = best_plan(env.unwrapped.get_state(), np.append(plan[1:], 0.0), futures, rng)
        _, _, _, _, info = env.step(plan[:1])
        if info["tip_height"] < 0.9 or abs(info["omega"][0]) > 1.0:
            since = info["time"]
    print(f"upright after {since:.2f} s, and for the {info['time'] - since:.2f} s since")
    return info["time"] - since


if __name__ == "__main__":
    main()
