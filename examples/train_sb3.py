"""Train with Stable-Baselines3 or sb3-contrib, any algorithm, from a file in RL Zoo's format.

Run it with `python examples/train_sb3.py swingup-2`; it reads `examples/configs/swingup-2.yml` (or
the file given) and writes checkpoints, TensorBoard logs and a model card to `runs/swingup-2`.
`--resume` goes on from the last checkpoint. Checkpoints are weights only: loading runs no code.
"""

from __future__ import annotations

import argparse
import importlib
import json
import shutil
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym
import stable_baselines3
import torch
import yaml
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

import npend_gym
from npend_gym.rl.adapter import SB3VecEnv
from npend_gym.rl.evaluation import Agent, evaluate

CONFIGS = Path(__file__).parent / "configs"


def algorithm(name: str) -> type[BaseAlgorithm]:
    """Return the class of that name, "ppo" say, of Stable-Baselines3 or sb3-contrib."""
    for module in filter(find_spec, ("stable_baselines3", "sb3_contrib")):
        kind = getattr(importlib.import_module(module), name.upper(), None)
        if kind is not None:
            return kind
    raise ValueError(f"algo must be in Stable-Baselines3 or sb3-contrib (installed?), got {name!r}")


def make_model(config: dict[str, Any], seed: int, log: str | None = None) -> BaseAlgorithm:
    """Return an untrained model on the environments that `config` describes."""
    settings = dict(config["NPendulum-v0"])
    settings.pop("n_timesteps")
    count, rate = settings.pop("n_envs", 1), settings["learning_rate"]
    if isinstance(rate, str):  # RL Zoo's "lin_1e-3": falls linearly to zero
        first = float(rate.removeprefix("lin_"))
        settings["learning_rate"] = lambda left: first * left
    envs = gym.make_vec(
        "NPendulum-v0", num_envs=count, autoreset_mode="SAME_STEP", **config["env_kwargs"]
    )
    kind = algorithm(config["algo"])
    return kind(env=SB3VecEnv(envs), seed=seed, tensorboard_log=log, device="cpu", **settings)


def agent_of(model: BaseAlgorithm) -> Agent:
    """Return the model's best actions as an agent to evaluate."""
    return lambda observation, _: model.predict(observation, deterministic=True)[0]


def held_out(config: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords for evaluation: the environment's own length of an episode."""
    return {k: v for k, v in config["env_kwargs"].items() if k != "max_episode_steps"}


def load_run(folder: Path) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """Return the best model of a run and its config; weights only, nothing is executed."""
    config = yaml.safe_load((folder / "config.yml").read_text(encoding="utf-8"))
    model = make_model(config, seed=0)
    model.set_parameters(torch.load(folder / "best.pth", weights_only=True)["parameters"])
    return model, config


class Keeper(BaseCallback):
    """Shows progress, evaluates on held-out seeds, keeps the last and the best weights."""

    def __init__(self, config: dict[str, Any], folder: Path, total: int, every: int) -> None:
        super().__init__()
        self.config, self.folder, self.every = config, folder, every
        self.bar = tqdm(total=total, unit="step", disable=None)
        self.best, self.score, self.due = (-1.0, -1.0), {}, 0

    def _on_step(self) -> bool:
        self.bar.update(self.num_timesteps - self.bar.n)
        return True

    def _on_rollout_start(self) -> None:  # the weights do not change before the next one
        if self.num_timesteps >= self.due:
            self.due = self.num_timesteps + self.every
            self.keep()

    def keep(self) -> None:
        """Evaluate and write the weights down."""
        score = evaluate(agent_of(self.model), held_out(self.config), episodes=50).as_row()
        for name in ("success", "return", "joules"):
            self.logger.record(f"held_out/{name}", score[name])
        kept = {"parameters": self.model.get_parameters(), "steps": self.model.num_timesteps}
        torch.save(kept, self.folder / "last.pth")
        if (score["success"], score["return"]) > self.best:
            self.best, self.score = (score["success"], score["return"]), score
            shutil.copyfile(self.folder / "last.pth", self.folder / "best.pth")


def model_card(config: dict[str, Any], seed: int, keeper: Keeper, seconds: float) -> str:
    """Return what somebody who finds the weights should know."""
    return f"""# {config["algo"].upper()} on NPendulum-v0, {config["env_kwargs"]}

Trained by `examples/train_sb3.py` for {keeper.num_timesteps} steps in {seconds:.0f} s, seed {seed},
with npend_gym {npend_gym.__version__}, Stable-Baselines3 {stable_baselines3.__version__} and
PyTorch {torch.__version__}. All settings are in `config.yml`.

The best weights, `best.pth`, in 50 episodes of seeds that training has not seen:

```json
{json.dumps(keeper.score, indent=2)}
```

They were chosen by these same episodes; judge them by others:
`python examples/evaluate.py --run FOLDER --seed 2000000`.
"""


def main() -> None:
    """Train, keep, and write the model card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help="name of a file in examples/configs, or path of a .yml")
    parser.add_argument("--out", type=Path, help="folder of the run (runs/TASK)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="environment steps in all, not those of the file")
    parser.add_argument("--every", type=int, default=100_000, help="steps between evaluations")
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    path = Path(arguments.task)
    path = path if path.suffix == ".yml" else CONFIGS / f"{path}.yml"
    if not path.exists():
        names = ", ".join(sorted(known.stem for known in CONFIGS.glob("*.yml")))
        parser.error(f"task must be a file or one of {names}; got {arguments.task}")
    folder = arguments.out or Path("runs") / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, folder / "config.yml")
    config = yaml.safe_load(path.read_text(encoding="utf-8"))
    total = arguments.steps or int(config["NPendulum-v0"]["n_timesteps"])
    torch.set_num_threads(1)  # two are slower for networks this small
    model = make_model(config, arguments.seed, str(folder / "tensorboard"))
    if arguments.resume:
        kept = torch.load(folder / "last.pth", weights_only=True)
        model.set_parameters(kept["parameters"])
        model.num_timesteps = kept["steps"]  # a replay buffer, if there is one, begins anew
    keeper = Keeper(config, folder, total, arguments.every)
    begun = time.perf_counter()
    try:
        left = max(0, total - model.num_timesteps)
        model.learn(left, callback=keeper, reset_num_timesteps=not arguments.resume)
    except KeyboardInterrupt:
        print("interrupted: kept up to here, --resume goes on")
    keeper.keep()
    keeper.bar.close()
    card = model_card(config, arguments.seed, keeper, time.perf_counter() - begun)
    (folder / "README.md").write_text(card, encoding="utf-8")
    print(f"{path.stem}: {keeper.score}\nwritten: {folder}")


if __name__ == "__main__":
    main()
