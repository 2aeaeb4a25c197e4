"""How algorithms learn the tasks of the benchmark: return and success against steps and time.

    python benchmarks/side_by_side.py --algorithms PPO ARS --tasks swingup-1 balance-2

trains on the public id of each task, with its default observation and episode, as
`docs/howto/benchmark.md` says. SHAC and imitation observe the same numbers unscaled, which the
protocol allows. `side_by_side.yml` has the settings, the same for all tasks.

At even distances of steps the policy plays the same validation episodes, which count neither as
steps nor as time. Each run is a file of `benchmarks/curves/`. A run whose file has as many steps is
not trained again, and an interrupted run begins again. The last policies go into the folder
`--models`, from where `npend benchmark` takes them: PPO/0/swingup-1.safetensors. `--publish` writes
the tables and the picture of `docs/notes/side_by_side.md`, and a table of `docs/notes/learning.md`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from copy import deepcopy
from itertools import product
from pathlib import Path
from pydoc import locate
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import yaml
from csv_tables import publish_table
from scipy.stats import sem
from stable_baselines3.common.callbacks import BaseCallback

from npend_gym import rl
from npend_gym.rl.training import Checkpoint, Stopwatch, imitation, shac
from npend_gym.tools import machine, replacing

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "examples"))
from train_sb3 import make_model  # noqa: E402

FILES = HERE / "curves"
FIGURE = HERE.parent / "docs" / "images" / "side_by_side.png"
PAGE = HERE.parent / "docs" / "notes" / "side_by_side.md"
SETTINGS: dict[str, dict[str, Any]] = yaml.safe_load((HERE / "side_by_side.yml").read_bytes())
OURS: dict[str, Any] = {"shac": shac, "imitation": imitation}
TUNING: dict[str, dict[str, Any]] = {  # tasks of no suite, on which settings were chosen
    "balance-1": {"id": "npend/Balance-v1", "n": 1},
    "swingup-1-cart": {"id": "npend/CartPole-v1", "mode": "swingup"},
    "swingup-1-medium": {"id": "npend/SwingUp-v1", "n": 1, "difficulty": "medium"},
}
PEERS = {"dm-acrobot": {"id": "npend/DMAcrobot-v1"}}  # tasks of other packages, of no suite
CORE = {name: task.env for name, task in rl.SUITES["core"].items()}
SUITED = CORE | {name: task.env for name, task in rl.SUITES["hard"].items()}
TASKS = SUITED | TUNING | PEERS
STEPS, SEEDS = 1_000_000, 5  # of the protocol
EPISODES = 40  # of an evaluation
EVALUATIONS = 40  # of a run
SOLVED = 0.95
COLUMNS = "steps", "seconds", "return", "success"
Run = dict[str, Any]
Key = tuple[str, str, int]


class Curve:
    """What a policy reaches in validation episodes, at even distances of steps."""

    def __init__(self, env: dict[str, Any], steps: int) -> None:
        self.env, self.steps = env, steps
        self.clock = Stopwatch()
        self.rows: list[tuple[float, ...]] = []

    def add(self, steps: int, model: Callable[[], Any], *, last: bool = False) -> None:
        """Evaluate what `model` returns where it is due; the clock stands still meanwhile."""
        due = steps >= (len(self.rows) + 1) * self.steps / EVALUATIONS
        if last or (due and steps < self.steps):
            seconds = self.clock.seconds
            found = rl.evaluate(plain(model()), self.env, episodes=EPISODES, seed=rl.VALIDATION)
            mean = round(float(found.returns.mean()), 2)
            self.rows.append((steps, round(seconds, 6), mean, found.success_rate))
            self.clock.seconds = seconds


def plain(model: Any) -> rl.Policy:
    """Return a model as a `Policy`, which acts faster."""
    return model if isinstance(model, rl.Policy) else rl.Policy.from_sb3(model)


class Calls(BaseCallback):
    """Adds to a curve while Stable-Baselines3 trains."""

    def __init__(self, curve: Curve) -> None:
        super().__init__()
        self.curve = curve

    def _on_step(self) -> bool:
        self.curve.add(self.num_timesteps, lambda: self.model)
        return True

    def _on_training_end(self) -> None:
        self.curve.add(self.num_timesteps, lambda: self.model, last=True)


class Rounds(Checkpoint):
    """Adds to a curve while a trainer of this package trains."""

    def __init__(self, settings: Any, curve: Curve, of_round: int) -> None:
        super().__init__(settings)
        self.curve, self.of_round = curve, of_round

    def rounds(self, parts: dict[str, Any], last: int, *args: Any, **options: Any) -> Iterator[int]:
        """Yield the rounds, and evaluate after each where it is due."""
        self.curve.clock = parts["clock"]
        learner = parts.get("learner") or parts["dagger"]
        # imitation has a round 0, and plays two rounds with each plan that it tries
        earlier = 2 * parts["choice"][1] - 1 if "choice" in parts else 0
        for round_ in super().rounds(parts, last, *args, **options):
            yield round_
            steps = (round_ + earlier) * self.of_round
            self.curve.add(steps, lambda: learner.policy({}), last=round_ == last)


def by_ours(chosen: dict[str, Any], curve: Curve, seed: int) -> rl.Policy:
    """Return a policy of a trainer of this package; `chosen` is given the length of the run."""
    trainer = OURS[chosen.pop("algo")]
    env = gym.spec(curve.env["id"]).kwargs | curve.env
    del env["id"]
    default = trainer.Settings(**chosen)
    if trainer is shac:
        env.pop("max_tilt", None)  # which it does not know; its episodes are short
        of_round = default.num_envs * default.horizon
        chosen["total_timesteps"] = curve.steps
    else:
        episode = round(default.seconds / rl.setting_of(curve.env).config.dt) + default.standing
        of_round = default.num_envs * episode
        chosen["rounds"] = max(2, curve.steps // of_round - 2 * default.guesses + 1)
    settings = trainer.Settings(env=env, seed=seed, **chosen)
    return trainer.train(settings, None, Rounds(settings, curve, of_round))[0]


def by_sb3(chosen: dict[str, Any], curve: Curve, seed: int) -> Any:
    """Return a model of Stable-Baselines3, sb3-contrib or SBX."""
    env = dict(curve.env)
    section = {"n_timesteps": curve.steps} | {k: v for k, v in chosen.items() if k != "algo"}
    if (seconds := section.pop("episode", None)) is not None:
        env["max_episode_steps"] = round(seconds / rl.setting_of(env).config.dt)
    algo = locate(chosen["algo"]) or chosen["algo"]  # "sbx.SAC", or "ppo"
    model = make_model({"algo": algo, env.pop("id"): section | {"env_kwargs": env}}, seed)
    if chosen["algo"] == "ars":
        model.evaluate_candidates = lambda *given: returns_of(model, *given[:2])
    curve.clock = Stopwatch()
    model.learn(curve.steps, callback=Calls(curve), log_interval=None)
    model.get_env().close()
    return model


def returns_of(model: Any, weights: torch.Tensor, callback: BaseCallback) -> torch.Tensor:
    """Return the returns of ARS's linear candidates, each in a sub-environment of its own."""
    size = len(weights)
    linear = weights.reshape(size, -1, model.observation_space.shape[0]).numpy()
    observation, returns = model.env.reset(), np.zeros(size, np.float32)
    running = np.ones(size, np.bool_)
    while running.any():
        action = np.einsum("bak,bk->ba", linear, observation).clip(-1.0, 1.0)
        observation, reward, done, _ = model.env.step(action)
        returns += np.where(running, reward, 0.0)
        model.num_timesteps += int(running.sum())  # steps after an episode are not used
        running &= ~done
        callback.on_step()
    return torch.from_numpy(returns)


def train(algorithm: str, task: str, seed: int, steps: int, models: Path) -> Run:
    """Train, keep the last policy, and return what the file of the run holds."""
    chosen = deepcopy(SETTINGS[algorithm])  # Stable-Baselines3 writes into policy_kwargs
    ours = chosen["algo"] in OURS
    curve = Curve(TASKS[task] | ({"observation": "sincos"} if ours else {}), steps)
    model = plain((by_ours if ours else by_sb3)(chosen, curve, seed))
    place = models / algorithm / str(seed)
    place.mkdir(parents=True, exist_ok=True)
    model.save(place / f"{task}.safetensors")
    returns = rl.evaluate(model, curve.env).returns
    return {
        "algorithm": algorithm, "task": task, "seed": seed, "total_steps": steps,
        "env": curve.env, "settings": SETTINGS[algorithm] | chosen, "episodes": EPISODES,
        "held_out": [round(float(x), 2) for x in (returns.mean(), sem(returns))],
        "machine": machine(("torch", "stable-baselines3", "sb3-contrib", "sbx-rl", "jax")),
        **dict(zip(COLUMNS, map(list, zip(*curve.rows, strict=True)), strict=True)),
    }  # fmt: skip


def write(path: Path, run: Run) -> None:
    """Write the file of a run, whole or not at all, a line for each of its parts."""
    lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value)}" for key, value in run.items())
    with replacing(path) as file:
        file.write(f"{{\n{lines}\n}}\n")


def groups(folder: Path, tasks: Collection[str] = SUITED) -> dict[Key, list[Run]]:
    """Return the seeds of each task, algorithm and number of steps, in order."""
    found: dict[Key, list[Run]] = defaultdict(list)
    for path in sorted(folder.glob("*.json")):
        run = json.loads(path.read_text(encoding="utf-8"))
        if run["task"] in tasks:
            found[run["task"], run["algorithm"], run["total_steps"]].append(run)
    order = sorted(found, key=lambda k: ([*TASKS].index(k[0]), [*SETTINGS].index(k[1]), k[2]))
    return {key: sorted(found[key], key=lambda run: run["seed"]) for key in order}


def solved(run: Run) -> tuple[float, float]:
    """Return steps and seconds of the first evaluation with 95 % success, or infinity."""
    rows = zip(*(run[name] for name in COLUMNS), strict=True)
    return next(((s, t) for s, t, _, success in rows if success >= SOLVED), (np.inf, np.inf))


def mean_of(runs: list[Run], column: str, k: int = -1, draws: int = 500) -> tuple[float, ...]:
    """Return the interquartile mean over the seeds in one evaluation, with its interval."""
    values = np.array([[run[column][k]] for run in runs])
    return rl.interquartile_mean(values), *rl.bootstrap_interval(values, resamples=draws)


def markdown(titles: tuple[str, ...], rows: list[list[str]]) -> str:
    """Return a table, whose columns after the second stand at the right."""
    lines = [titles, ["---"] * 2 + ["---:"] * (len(titles) - 2), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def grouped(number: float) -> str:
    """Return a whole number with its thousands apart."""
    return f"{number:,.0f}".replace(",", " ")


def results(found: dict[Key, list[Run]]) -> str:
    """Return the table of what algorithms reach, and when."""
    rows: list[list[str]] = []
    for (task, algorithm, steps), runs in found.items():
        middle, low, high = (100.0 * each for each in mean_of(runs, "success"))
        when = np.array([solved(run) for run in runs])
        reached, (at, after) = np.isfinite(when[:, 0]).sum(), np.median(when, axis=0)
        rows.append([
            task, algorithm, grouped(steps), str(len(runs)),
            f"{middle:.0f} %" + f" ({low:.0f} to {high:.0f})" * (low < high),
            f"{mean_of(runs, 'return')[0]:.0f}", f"{reached} of {len(runs)}",
            *((grouped(at), f"{after:.0f} s") if np.isfinite(at) else ("-", "-")),
        ])  # fmt: skip
    titles = ("task", "algorithm", "steps", "seeds", "success at the end", "return at the end",
              "seeds that reach 95 %", "steps to 95 %", "time to 95 %")  # fmt: skip
    return markdown(titles, rows)


def costs(found: dict[Key, list[Run]]) -> str:
    """Return the table of what the whole core suite takes at the speed of the runs."""
    rows: list[list[str]] = []
    for algorithm in dict.fromkeys(name for _, name, _ in found):
        kept = [key for key in found if key[1] == algorithm]
        runs = [run for key in kept for run in found[key]]
        rate = np.median([run["steps"][-1] / run["seconds"][-1] for run in runs])
        hours = len(CORE) * SEEDS * STEPS / rate / 3600.0
        rows.append([algorithm, ", ".join(k[0] for k in kept), grouped(rate), f"{hours:.2g}"])
    return markdown(("algorithm, on one core", "tasks", "steps a second", "hours"), rows)


def tuning(found: dict[Key, list[Run]]) -> str:
    """Return the table of the settings that were tried on the tasks of `TUNING`."""
    rows: list[list[str]] = []
    for (task, algorithm, steps), runs in found.items():
        seconds, value, share = (np.median([r[x][-1] for r in runs]) for x in COLUMNS[1:])
        cells = f"{100.0 * share:.0f} %", f"{value:.0f}", f"{seconds:.0f} s"
        rows.append([task, algorithm, grouped(steps), *cells])
    return markdown(("task", "tried", "steps", "success", "return", "time"), rows)


def peers(found: dict[Key, list[Run]]) -> str:
    """Return the table of returns in held-out episodes, with standard errors, of each seed."""
    rows = [
        [algorithm, grouped(steps), f"{np.mean([run['held_out'][0] for run in runs]):.0f}",
         ", ".join("{:.0f} +- {:.0f}".format(*run["held_out"]) for run in runs)]
        for (_, algorithm, steps), runs in found.items()
    ]  # fmt: skip
    return markdown(("algorithm", "steps", "mean return", "each seed +- standard error"), rows)


def draw(found: dict[Key, list[Run]], path: Path) -> None:
    """Draw success and return against steps and processor time, a row for each task."""
    from matplotlib.figure import Figure

    tasks = list(dict.fromkeys(task for task, _, _ in found))
    names = [name for name in SETTINGS if any(name == known for _, known, _ in found)]
    figure: Any = Figure(figsize=(13.0, 2.6 * len(tasks) + 0.6), layout="constrained")
    panels = figure.subplots(len(tasks), 4, squeeze=False)
    lines: dict[str, Any] = {}
    for (task, algorithm, _), runs in found.items():
        count = range(min(len(run["steps"]) for run in runs))
        for k, y in enumerate(("success", "return")):
            middle, low, high = np.array([mean_of(runs, y, at, 100) for at in count]).T
            for x, axes in zip(COLUMNS, panels[tasks.index(task), 2 * k : 2 * k + 2], strict=False):
                place = [np.median([run[x][at] for run in runs]) for at in count]
                color = f"C{names.index(algorithm)}"
                (lines[algorithm],) = axes.plot(place, middle, ".-", color=color, lw=1.3, ms=3.0)
                axes.fill_between(place, low, high, color=color, alpha=0.2, lw=0.0)
                axes.set(xscale="log", title=task, ylabel=y)
                axes.set_xlabel("environment steps" if x == "steps" else "processor time [s]")
    for axes in panels[:, :2].ravel():
        axes.set_ylim(-0.04, 1.04)
    for axes in panels.ravel():
        axes.xaxis.set_minor_formatter("")
    figure.legend([lines[name] for name in names], names, loc="outside lower center", ncols=7)
    figure.savefig(path, dpi=100)


def publish(folder: Path) -> None:
    """Write the tables and the picture of the page."""
    found = groups(folder)
    tables = [(PAGE, results(found)), (PAGE, costs(found)), (PAGE, tuning(groups(folder, TUNING)))]
    for page, table in [*tables, (PAGE.with_name("learning.md"), peers(groups(folder, PEERS)))]:
        publish_table(page, table.partition("\n")[0], table)
    draw(found, FIGURE)


def main() -> None:
    """Train what is missing, each run into a file of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algorithms", nargs="*", choices=SETTINGS, default=[])
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(CORE))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(SEEDS)))
    parser.add_argument("--steps", type=int, default=STEPS, help="of a run")
    parser.add_argument("--out", type=Path, default=FILES, help="folder of the files")
    parser.add_argument("--models", type=Path, default=Path("results/side_by_side"))
    parser.add_argument("--publish", action="store_true", help="in docs/")
    arguments = parser.parse_args()
    if arguments.steps < EVALUATIONS:
        parser.error(f"--steps must be at least {EVALUATIONS}, got {arguments.steps}")
    torch.set_num_threads(1)  # two are slower for networks this small
    one = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ.setdefault("XLA_FLAGS", one)  # before JAX is imported
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed, task, algorithm in product(arguments.seeds, arguments.tasks, arguments.algorithms):
        path = arguments.out / f"{task}-{algorithm}-{seed}.json"
        if path.exists() and json.loads(path.read_text())["total_steps"] >= arguments.steps:
            continue
        run = train(algorithm, task, seed, arguments.steps, arguments.models)
        write(path, run)
        last = ", ".join(f"{name} {run[name][-1]:g}" for name in COLUMNS)
        print(f"{path.stem}: {last}", flush=True)
    if arguments.publish:
        publish(arguments.out)


if __name__ == "__main__":
    main()
