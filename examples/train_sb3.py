"""Train with Stable-Baselines3 or sb3-contrib, any algorithm, from a file in RL Zoo's format.

RL Zoo reads the same file, in its line `algo` too: `python -m rl_zoo3.train --algo ppo --env
npend/SwingUp-v1 --gym-packages npend_gym --conf-file examples/configs/swingup-2.yml`.

Run it with `python examples/train_sb3.py swingup-2`; it reads `examples/configs/swingup-2.yml` (or
the file given) and writes checkpoints, TensorBoard logs and a model card to `runs/swingup-2`, and
`policy.safetensors` for `npend evaluate`. `--resume` continues from the last checkpoint.
Checkpoints hold weights only: loading runs no code.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import shutil
import time
from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym
import stable_baselines3
import torch
import yaml
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize
from tqdm import tqdm

import npend_gym
from npend_gym.rl import VALIDATION, Policy, SB3VecEnv, episode_seeds, evaluate
from npend_gym.rl.training import evaluation_env

SCRIPT = "examples/train_sb3.py"  # named in the record of a policy
CONFIGS = Path(__file__).parent / "configs"
SCHEDULES = "learning_rate", "clip_range", "clip_range_vf"
LITERALS = "normalize", "policy_kwargs"


def algorithm(name: str | type[BaseAlgorithm]) -> type[BaseAlgorithm]:
    """Return the class of that name, "ppo" say, of Stable-Baselines3 or sb3-contrib."""
    if isinstance(name, type):  # of another library, such as SBX
        return name
    for module in filter(find_spec, ("stable_baselines3", "sb3_contrib")):
        for known, found in vars(importlib.import_module(module)).items():  # CrossQ is not CROSSQ
            if isinstance(found, type) and known.lower() == str(name).lower():
                return found
    raise ValueError(f"algo must be in Stable-Baselines3 or sb3-contrib (installed?), got {name!r}")


def section(config: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the id of the environment and its settings, the one section in RL Zoo's format."""
    parts = config if isinstance(config, dict) else {}  # a file may hold anything
    found = [(name, dict(value)) for name, value in parts.items() if isinstance(value, dict)]
    if "algo" not in parts or len(found) != 1 or "n_timesteps" not in found[0][1]:
        raise ValueError(
            "a file of settings must have a line `algo`, and one section, named after the "
            f"environment, with n_timesteps; got {config!r}"
        )
    return found[0]


def schedule(value: Any) -> Any:
    """Return a setting that may fall linearly to zero, as RL Zoo's "lin_1e-3" does."""
    if not isinstance(value, str):
        return value
    if not value.startswith("lin_"):
        return float(value)  # YAML takes 1e-3 for a text
    initial = float(value.removeprefix("lin_"))
    return lambda left: initial * max(left, 0.0)  # the last rollout may go beyond the end


class DictCalls(ast.NodeTransformer):
    """Writes ``dict(a=1)`` as ``{"a": 1}``."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Change one call; others are refused later."""
        self.generic_visit(node)
        names = [each.arg for each in node.keywords]
        if ast.unparse(node.func) != "dict" or node.args or None in names:
            return node
        return ast.Dict([*map(ast.Constant, names)], [each.value for each in node.keywords])


def literal(name: str, value: Any) -> Any:
    """Return a setting that may be a text, as RL Zoo has it, without running this text."""
    if not isinstance(value, str):
        return value
    try:
        return ast.literal_eval(DictCalls().visit(ast.parse(value, mode="eval")))
    except (SyntaxError, ValueError) as error:
        raise ValueError(
            f"{name} must have numbers, texts, lists and dicts alone, because its text is not run; "
            f"got {value!r}: write it so, or as YAML"
        ) from error


def make_model(config: dict[str, Any], seed: int, log: str | None = None) -> BaseAlgorithm:
    """Return an untrained model on the environments that `config` describes."""
    env_id, settings = section(config)
    settings.pop("n_timesteps")
    num_envs, keywords = settings.pop("n_envs", 1), settings.pop("env_kwargs", {})
    settings |= {name: schedule(settings[name]) for name in SCHEDULES if name in settings}
    settings |= {name: literal(name, settings[name]) for name in LITERALS if name in settings}
    normalize = settings.pop("normalize", None)
    envs = gym.make_vec(env_id, num_envs=num_envs, autoreset_mode="SAME_STEP", **keywords)
    venv = SB3VecEnv(envs)
    if normalize:  # as in RL Zoo, by the running mean and deviation
        more = normalize if isinstance(normalize, dict) else {}
        venv = VecNormalize(venv, gamma=settings.get("gamma", 0.99), **more)
    model_class = algorithm(config["algo"])
    first = episode_seeds("training", num_envs, run=seed, spacing=num_envs).start
    return model_class(env=venv, seed=first, tensorboard_log=log, device="cpu", **settings)


def statistics_of(model: BaseAlgorithm) -> dict[str, dict[str, Any]]:
    """Return the running statistics of observations and returns, where there are any."""
    venv = model.get_vec_normalize_env()
    if venv is None:
        return {}
    seen = getattr(venv, "obs_rms", {})  # with goals, of each part of an observation
    found: dict[str, Any] = seen if isinstance(seen, dict) else {"observations": seen}
    found = found | {"returns": venv.ret_rms}
    return {name: vars(each) for name, each in found.items()}


def state_of(model: BaseAlgorithm) -> dict[str, Any]:
    """Return weights, steps and statistics: what a checkpoint holds of a model."""
    state: dict[str, Any] = {"parameters": model.get_parameters(), "steps": model.num_timesteps}
    for name, statistics in statistics_of(model).items():
        state[name] = {key: torch.as_tensor(value) for key, value in statistics.items()}
    return state


def restore(model: BaseAlgorithm, path: Path) -> None:
    """Give a model the state of a checkpoint."""
    state = torch.load(path, weights_only=True)
    model.set_parameters(state["parameters"])
    model.num_timesteps = state["steps"]
    for name, statistics in statistics_of(model).items():
        statistics |= {key: value.numpy() for key, value in state.get(name, {}).items()}


def load_run(folder: Path, *, trust: bool = False) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """Return the best model of a run and its config; without `trust` no code of the run is run."""
    config = yaml.safe_load((folder / "config.yml").read_text(encoding="utf-8"))
    env_id, settings = section(config)
    mode = str(settings.get("env_kwargs", {}).get("mode"))
    for name in (mode, env_id.removeprefix("npend_gym:")):
        if ":" in name and not trust:
            raise ValueError(f"{folder} names {name!r}, which is imported only with --trust")
    model = make_model(config, seed=0)
    restore(model, folder / "best.pth")
    return model, config


def score_of(model: BaseAlgorithm, config: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Return how well a model does in episodes of the environment that `config` describes."""
    env_id, settings = section(config)
    keywords = evaluation_env(settings.get("env_kwargs", {}))
    return evaluate(model, keywords | {"id": env_id}, **options).as_row()


class Checkpoints(BaseCallback):
    """Shows progress, evaluates now and then, writes the last and the best weights."""

    def __init__(
        self, config: dict[str, Any], folder: Path, total: int, every: int, seed: int
    ) -> None:
        super().__init__()
        self.config, self.folder, self.every, self.seed = config, folder, every, seed
        self.bar = tqdm(total=total, unit="step", disable=None)
        self.best, self.next_save = (-1.0, -1.0), 0
        self.earlier_seconds, self.start_time = 0.0, time.process_time()

    @property
    def seconds(self) -> float:
        """The processor time of the run, with that before --resume."""
        return self.earlier_seconds + time.process_time() - self.start_time

    def _on_step(self) -> bool:
        self.bar.update(self.num_timesteps - self.bar.n)
        return True

    def _on_rollout_start(self) -> None:  # the weights do not change before the next one
        if self.num_timesteps >= self.next_save:
            self.next_save = self.num_timesteps + self.every
            self.save()

    def save(self) -> None:
        """Evaluate the model and write its weights."""
        score = score_of(self.model, self.config, episodes=50, seed=VALIDATION)
        for name in ("success", "return", "motor_work"):
            self.logger.record(f"evaluation/{name}", score[name])
        reached = float(score["success"]), float(score["return"])
        is_best, self.best = reached > self.best, max(reached, self.best)
        state = state_of(self.model) | {"best": self.best, "seconds": self.seconds}
        state["seed"] = self.seed
        for name in ("best", "last") if is_best else ("last",):
            temporary = self.folder / f"{name}.part"  # an interruption leaves the checkpoint before
            torch.save(state, temporary)
            temporary.replace(self.folder / f"{name}.pth")


def model_card(config: dict[str, Any], seed: int, score: dict[str, Any], made: str) -> str:
    """Return a description of the weights for whoever finds them."""
    env_id, settings = section(config)
    return f"""# {config["algo"].upper()} on {env_id}, {settings.get("env_kwargs", {})}

Trained by `examples/train_sb3.py` for {made},
seed {seed}, with npend_gym {npend_gym.__version__}, Stable-Baselines3
{stable_baselines3.__version__} and PyTorch {torch.__version__}. All settings are in `config.yml`.

The best weights, `best.pth`, in held-out episodes, which neither training nor the choice among the
checkpoints has seen:

```json
{json.dumps(score, indent=2)}
```
"""


def policy_of(model: BaseAlgorithm, config: dict[str, Any], seed: int, **record: Any) -> Policy:
    """Return the model as plain numbers, with what made it; ValueError if it is no such network."""
    policy = Policy.from_sb3(model)
    policy = replace(policy, env=evaluation_env(policy.env))
    arguments = {"config": config, "env": policy.env, "seed": seed}
    made = {"trained_by": SCRIPT, "clock": "processor time", "arguments": arguments}
    policy.provenance.update(made | record)
    return policy


def main() -> None:
    """Train, write checkpoints and the model card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help="name of a file in examples/configs, or path of a .yml")
    parser.add_argument("--out", type=Path, help="folder of the run (runs/TASK)")
    parser.add_argument("--seed", type=int, help="of the run (0)")
    parser.add_argument(
        "--steps", type=int, help="environment steps in total, in place of the file's"
    )
    parser.add_argument("--every", type=int, default=100_000, help="steps between evaluations")
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    path = Path(arguments.task)
    path = path if path.suffix == ".yml" else CONFIGS / f"{path}.yml"
    if not path.exists():
        names = ", ".join(sorted(known.stem for known in CONFIGS.glob("*.yml")))
        parser.error(f"task must be a file or one of {names}; got {arguments.task}")
    if arguments.steps is not None and arguments.steps < 1:
        parser.error(f"--steps must be at least 1, got {arguments.steps}")
    folder = arguments.out or Path("runs") / path.stem
    last, kept = folder / "last.pth", folder / "config.yml"
    config = yaml.safe_load(path.read_text(encoding="utf-8"))
    if last.exists() and not arguments.resume:
        parser.error(f"{last} exists: continue its run with --resume, or choose another --out")
    if arguments.resume and not last.exists():
        parser.error(f"--resume needs the checkpoint {last}, which does not exist")
    if arguments.resume and yaml.safe_load(kept.read_text(encoding="utf-8")) != config:
        parser.error(f"--resume needs the settings of the run: {path} differs from {kept}")
    state = torch.load(last, weights_only=True) if arguments.resume else {}
    seed = state.get("seed", arguments.seed or 0)
    if arguments.seed not in (None, seed):
        parser.error(f"--resume needs the seed of the run, {seed}; got {arguments.seed}")
    total = arguments.steps or int(float(section(config)[1]["n_timesteps"]))
    torch.set_num_threads(1)  # two are slower for networks this small
    model = make_model(config, seed, str(folder / "tensorboard"))
    checkpoints = Checkpoints(config, folder, total, arguments.every, seed)
    if arguments.resume:  # a replay buffer starts empty again
        restore(model, last)
        checkpoints.best = state.get("best", checkpoints.best)
        checkpoints.earlier_seconds = state.get("seconds", 0.0)
        checkpoints.next_save = model.num_timesteps + arguments.every
    folder.mkdir(parents=True, exist_ok=True)
    with suppress(shutil.SameFileError):
        shutil.copyfile(path, kept)
    try:
        remaining = max(0, total - model.num_timesteps)
        model.learn(remaining, callback=checkpoints, reset_num_timesteps=not arguments.resume)
    except KeyboardInterrupt:
        print("interrupted: the weights are written, --resume continues from them")
    checkpoints.save()
    checkpoints.bar.close()
    seconds = checkpoints.seconds
    training = {"steps": model.num_timesteps, "seconds": round(seconds, 2)}
    made = f"{model.num_timesteps} steps in {seconds:.0f} s of processor time"
    restore(model, folder / "best.pth")
    score = score_of(model, config)
    record = {"training": training, "evaluation": score}
    try:
        policy_of(model, config, seed, **record).save(folder / "policy.safetensors")
    except ValueError as error:
        print(f"no policy.safetensors is written: {error}")
    card = model_card(config, seed, score, made)
    (folder / "README.md").write_text(card, encoding="utf-8")
    print(f"{path.stem}: {score}\nwritten: {folder}")


if __name__ == "__main__":
    main()
