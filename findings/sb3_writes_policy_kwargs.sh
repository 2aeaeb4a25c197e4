#!/usr/bin/env bash
# Stable-Baselines3 2.9.2: SAC, TQC and their like write "use_sde" into the dict that the caller gives as
# `policy_kwargs`. Where several algorithms share one dict, as by an anchor in YAML, DQN, whose policy knows no such
# argument, fails then: "got an unexpected keyword argument 'use_sde'". Give each algorithm a copy.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q stable-baselines3==2.9.2 gymnasium==1.4.0 torch==2.13.0
"$folder/venv/bin/python" - <<'PYTHON'
from stable_baselines3 import DQN, SAC

shared = {"net_arch": [8]}
DQN("MlpPolicy", "CartPole-v1", policy_kwargs=dict(shared), device="cpu")
SAC("MlpPolicy", "Pendulum-v1", policy_kwargs=shared, device="cpu")
print("after SAC:", shared)
assert shared == {"net_arch": [8], "use_sde": False}, "changed"
try:
    DQN("MlpPolicy", "CartPole-v1", policy_kwargs=shared, device="cpu")
    said = "nothing"
except TypeError as error:
    said = str(error)
print("DQN with the same dict:", said)
assert "unexpected keyword argument 'use_sde'" in said, "changed"
PYTHON
