#!/usr/bin/env bash
# Gymnasium 1.4.0 with MuJoCo 4.0.0: gravity of InvertedDoublePendulum-v5 leans by 1e-5 m/s^2 along the rail (in
# its file: "1e-5 0 -9.81"). The upright state at rest is no equilibrium: without any action it falls, always to
# the same side, where that of InvertedPendulum-v5 stands for ever. Set `model.opt.gravity` for a symmetric task.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q gymnasium==1.4.0 mujoco==4.0.0 imageio==2.38.1
"$folder/venv/bin/python" - <<'PYTHON'
import gymnasium as gym
import numpy as np


def standing(name):
    env = gym.make(name).unwrapped
    env.reset(seed=0)
    env.set_state(np.zeros(env.model.nq), np.zeros(env.model.nv))
    for step in range(1000):
        if env.step(np.zeros(env.action_space.shape))[2]:
            return env, step, np.sign(env.data.qpos[1])
    return env, None, 0.0


print("gymnasium", gym.__version__)
env, fell, side = standing("InvertedDoublePendulum-v5")
print("InvertedDoublePendulum-v5: gravity", env.model.opt.gravity, "falls at step", fell, "to the side", side)
assert env.model.opt.gravity[0] == 1e-5, "changed"
assert fell is not None, "changed"
env, never, _ = standing("InvertedPendulum-v5")
print("InvertedPendulum-v5: gravity", env.model.opt.gravity, "falls at step", never)
assert never is None, "changed"
PYTHON
