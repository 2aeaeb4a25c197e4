#!/usr/bin/env bash
# SBX 0.28.0 (JAX): `get_parameters()` of every algorithm returns an empty dict, where Stable-Baselines3 2.9.2,
# whose interface SBX has, returns all weights. `set_parameters` takes the empty dict and raises nothing, so
# that a checkpoint or a copy made by these two methods keeps none of the weights. Use `save` and `load`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q sbx-rl==0.28.0 stable-baselines3==2.9.2 gymnasium==1.4.0 torch==2.13.0 jax==0.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import tempfile
from pathlib import Path

import sbx
import stable_baselines3 as sb3

there = sb3.SAC("MlpPolicy", "Pendulum-v1", device="cpu", seed=0).get_parameters()
print("Stable-Baselines3, SAC:", [*there])
assert there["policy"], "changed"
for name in ("SAC", "TQC", "CrossQ", "TD3", "PPO"):
    found = getattr(sbx, name)("MlpPolicy", "Pendulum-v1").get_parameters()
    print(f"SBX, {name}:", found)
    assert found == {}, "changed"

trained, fresh = (sbx.SAC("MlpPolicy", "Pendulum-v1", seed=seed) for seed in (0, 1))
observation = trained.observation_space.sample()
fresh.set_parameters(trained.get_parameters())
with tempfile.TemporaryDirectory() as folder:
    trained.save(Path(folder) / "a.zip")
    loaded = sbx.SAC.load(Path(folder) / "a.zip")
first, second, third = (
    float(model.predict(observation, deterministic=True)[0][0]) for model in (trained, fresh, loaded)
)
print(f"actions: {first:.3f}; after set_parameters {second:.3f}; after load {third:.3f}")
assert first == third != second, "changed"
PYTHON
