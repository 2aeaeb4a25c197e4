#!/usr/bin/env bash
# Stable-Baselines3 2.9.2: `progress_remaining`, which is given to schedules "from 1 to 0", goes below zero where
# the number of steps is no multiple of a rollout. PPO with rollouts of 256 steps and 300 steps in all trains its
# second half with -0.7. A schedule "initial * progress" then has a negative learning rate, so that updates
# increase the loss, without a word. `LinearSchedule` of the library itself stays at its end.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q stable-baselines3==2.9.2 gymnasium==1.4.0 torch==2.13.0
"$folder/venv/bin/python" - <<'PYTHON'
from stable_baselines3 import PPO
from stable_baselines3.common.utils import LinearSchedule


def rates(schedule, steps):
    """Return the learning rates that the optimizer has in the updates of a training."""
    found = []

    class Watched(PPO):
        def train(self):
            super().train()
            found.append(self.policy.optimizer.param_groups[0]["lr"])

    Watched(
        "MlpPolicy", "Pendulum-v1", n_steps=256, batch_size=64, n_epochs=1, learning_rate=schedule, device="cpu"
    ).learn(steps)
    return found


whole, part = (rates(lambda left: 1e-3 * left, steps) for steps in (512, 300))
print("512 steps:", whole)
print("300 steps:", part)
assert whole == [0.0005, 0.0], "changed"
assert part[0] > 0.0 > part[1] and abs(part[1] + 1e-3 * 212 / 300) < 1e-12, "changed"
own = rates(LinearSchedule(1e-3, 0.0, 1.0), 300)
print("300 steps, LinearSchedule:", own)
assert own[1] == 0.0, "changed"
PYTHON
