"""Steps of dm_control's own acrobot: `python tests/dm_acrobot.py` writes dm_acrobot.json.

dm_control 1.0.50 loads its tasks with MuJoCo 3, and not with MuJoCo 4.
"""

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_suffix(".json")
FIELDS = "qpos", "qvel", "action", "orientations", "velocity", "dense", "sparse"


def load(sparse=False, seed=0):
    """Return dm_control's environment, or raise what its import or MuJoCo raise."""
    from dm_control import suite

    name = "swingup_sparse" if sparse else "swingup"
    return suite.load("acrobot", name, task_kwargs={"random": seed})


def steps_of(count):
    """Return `count` steps, each of an episode of its own: state, action, what follows.

    Every fourth is near the target, which random actions do not reach.
    """
    env, other, rng = load(), load(sparse=True), np.random.default_rng(0)
    rows = {name: [] for name in FIELDS}
    for k in range(count):
        env.reset()
        for _ in range(rng.integers(100)):
            env.step(rng.uniform(-1.0, 1.0, 1))
        physics = env.physics
        if k % 4 == 0:
            with physics.reset_context():
                physics.data.qpos[:] = rng.normal(0.0, 0.1, 2)
                physics.data.qvel[:] = rng.normal(0.0, 0.5, 2)
        rows["qpos"].append(physics.data.qpos.tolist())
        rows["qvel"].append(physics.data.qvel.tolist())
        action = rng.uniform(-1.0, 1.0, 1)
        step = env.step(action)
        rows["action"].append(action.tolist())
        for name in ("orientations", "velocity"):
            rows[name].append(step.observation[name].tolist())
        rows["dense"].append(float(step.reward))
        rows["sparse"].append(float(other.task.get_reward(physics)))
    return rows


def motion_of(seed):
    """Return the start of an episode, its actions, and the coordinates after every step."""
    env, rng = load(seed=seed), np.random.default_rng(seed)
    env.reset()
    start, actions = env.physics.data.qpos.copy(), rng.uniform(-1.0, 1.0, (1000, 1))
    states = []
    for action in actions:
        env.step(action)
        states.append(env.physics.data.qpos.copy())
    return start, actions, np.array(states)


if __name__ == "__main__":
    made = {name: version(name) for name in ("dm_control", "mujoco")} | steps_of(48)
    FILE.write_text(json.dumps(made) + "\n", encoding="utf-8")
