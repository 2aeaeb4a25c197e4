#!/usr/bin/env bash
# Gymnasium 1.4.0 with MuJoCo 4.0.0: neither inverted pendulum is symmetric. Gravity of InvertedDoublePendulum-v5
# leans by 1e-5 m/s^2 along the rail ("1e-5 0 -9.81" in its file), and the pole of InvertedPendulum-v5 by 1 mm.
# Put upright at rest and left alone, both fall, always to the same side. With gravity of "0 0 -9.81" the double
# pendulum stands for ever. A policy that mirrors its observations is not as good on both sides.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q gymnasium==1.4.0 mujoco==4.0.0 imageio==2.38.1 packaging==26.3
"$folder/venv/bin/python" - <<'PYTHON'
import gymnasium as gym
import numpy as np


def falls(name, upright):
    """Return the step at which the pendulum falls from rest, the angle then, and the environment."""
    env = gym.make(name).unwrapped
    env.reset(seed=0)
    if upright:
        env.model.opt.gravity[:] = 0.0, 0.0, -9.81
    env.set_state(np.zeros(env.model.nq), np.zeros(env.model.nv))
    for step in range(1000):
        if env.step(np.zeros(env.action_space.shape))[2]:
            return step, env.data.qpos[1], env
    return None, env.data.qpos[1], env


print("gymnasium", gym.__version__)
found = {}
for name in ("InvertedDoublePendulum-v5", "InvertedPendulum-v5"):
    for upright in (False, True):
        step, angle, env = falls(name, upright)
        found[name, upright] = step
        print(name, "gravity", env.model.opt.gravity, "falls at step", step, "angle", round(angle, 3))
    print("  centre of mass of the last pole:", env.model.body_ipos[-1])
assert found["InvertedDoublePendulum-v5", False] is not None, "changed"
assert found["InvertedDoublePendulum-v5", True] is None, "changed"
assert found["InvertedPendulum-v5", True] is not None, "changed"
assert abs(env.model.body_ipos[-1][0] - 0.0005) < 1e-6, "changed"
PYTHON
