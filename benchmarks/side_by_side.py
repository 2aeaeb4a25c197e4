"""What several algorithms learn in five minutes of processor time, on the same tasks.

    python benchmarks/side_by_side.py --out results/side_by_side --publish

trains PPO, SAC and TQC of Stable-Baselines3 and sb3-contrib beside SHAC and imitation of this
package. With "default" settings an algorithm runs as its library has it, on a single environment of
`gym.make`. With "tuned" settings it runs as one file of `examples/configs` says, the same for all
tasks, on a vector environment. SHAC and imitation have the settings of the task.

A run of Stable-Baselines3 ends when its policy succeeds in all of 50 validation episodes, or else
after five minutes of processor time; it is tried now and then. That of SHAC and imitation ends
where its settings say. The last policy is evaluated in 100 held-out episodes. Each run is a file in
the folder, so that this can be interrupted, or run several times at once with other `--tasks`.
All runs of a folder have the same `--budget`.
`--publish` puts the rows into `docs/results/side_by_side.csv`, the table into the page
`docs/notes/side_by_side.md`, and draws them; rows of runs that the folder lacks are kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
import yaml
from csv_tables import publish_table, texts
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

import npend_gym
from npend_gym.envs import EnvConfig
from npend_gym.report import write_csv, write_json
from npend_gym.rl import (
    VALIDATION,
    bootstrap_interval,
    episode_seeds,
    evaluate,
    interquartile_mean,
)
from npend_gym.rl.training import env_of_task, imitation, shac
from npend_gym.tools import machine

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "examples"))
from train_sb3 import CONFIGS, algorithm, make_model  # noqa: E402

CSV = ROOT / "docs" / "results" / "side_by_side.csv"
FIGURE = ROOT / "docs" / "images" / "side_by_side.png"
PAGE = ROOT / "docs" / "notes" / "side_by_side.md"
TASKS = tuple(
    f"{mode}-{chain}"
    for chain, mode in product(("1", "1-cart", "2", "2-acrobot"), ("balance", "swingup"))
)
TUNED = {"PPO": "swingup-1", "SAC": "swingup-1-sac", "TQC": "balance-2-tqc"}  # files of settings
OURS: dict[str, Any] = {"SHAC": shac, "imitation": imitation}
AGENTS = (*OURS, *(f"{name} {how}" for name, how in product(TUNED, ("tuned", "default"))))
BUDGET, CHECKED = 300.0, 15.0  # s of processor time: for all, and between trials of a policy
EPISODE = 10.0  # s, in training; an evaluation has the environment's own length
TRIALS = 50  # validation episodes in a trial
KEY = ("task", "agent", "seed")
MEANS: dict[str, Any] = {"mean": np.mean, "interquartile mean": interquartile_mean}
SOLVED = 0.95  # of a run that the curves of the figure count


class Budget(BaseCallback):
    """Ends a run when its policy succeeds in all trial episodes, or its time is over."""

    def __init__(self, env: dict[str, Any], budget: float) -> None:
        super().__init__()
        self.env, self.budget = env, budget
        self.begun, self.tried, self.next_trial = time.process_time(), 0.0, CHECKED

    @property
    def seconds(self) -> float:
        """The processor time of training, without that of the trials."""
        return time.process_time() - self.begun - self.tried

    def _on_step(self) -> bool:
        if self.seconds >= self.budget:
            return False
        if self.seconds < self.next_trial:
            return True
        self.next_trial += CHECKED
        before = time.process_time()
        found = evaluate(self.model, self.env, episodes=TRIALS, seed=VALIDATION)
        self.tried += time.process_time() - before
        return found.success_rate < 1.0


def model_of(task: str, agent: str, seed: int, left: Callable[[], float]) -> BaseAlgorithm:
    """Return an untrained model; `left` tells which share of its time it has left."""
    name, settings = agent.split()
    env = env_of_task(task)
    env["max_episode_steps"] = round(EPISODE / EnvConfig(**env).dt)
    if settings == "default":
        first = episode_seeds("training", 1, run=seed).start
        single = gym.make("NPendulum-v0", **env)
        return algorithm(name)("MlpPolicy", single, seed=first, device="cpu")
    config = yaml.safe_load((CONFIGS / f"{TUNED[name]}.yml").read_text(encoding="utf-8"))
    (section,) = (value for value in config.values() if isinstance(value, dict))
    rate = section["learning_rate"]
    if isinstance(rate, str):  # "lin_1e-3" falls linearly to zero: here over the time
        initial = float(rate.removeprefix("lin_"))
        section["learning_rate"] = lambda _: initial * left()
    section["env_kwargs"] = env
    return make_model({"algo": config["algo"], "NPendulum-v0": section}, seed)


def by_sb3(task: str, agent: str, seed: int, budget: float) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """Return a model that was trained, and its steps and seconds."""
    ends = Budget(env_of_task(task), budget)
    model = model_of(task, agent, seed, lambda: max(0.0, 1.0 - ends.seconds / budget))
    ends.begun = time.process_time()
    model.learn(10**9, callback=ends)
    model.get_env().close()
    return model, {"steps": model.num_timesteps, "seconds": round(ends.seconds, 1)}


def by_ours(task: str, agent: str, seed: int) -> tuple[npend_gym.rl.Policy, dict[str, Any]]:
    """Return a policy of a trainer of this package, and its steps and seconds."""
    trainer = OURS[agent]
    policy, curve = trainer.train(trainer.settings_of(task, seed=seed), f"{task}, {agent}")
    return policy, {"steps": curve[-1]["steps"], "seconds": round(curve[-1]["seconds"], 1)}


def run(task: str, agent: str, seed: int, budget: float) -> dict[str, Any]:
    """Train, evaluate in held-out episodes, and return what to keep."""
    found: tuple[Any, dict[str, Any]] = (
        by_ours(task, agent, seed) if agent in OURS else by_sb3(task, agent, seed, budget)
    )
    row = dict(zip(KEY, (task, agent, seed), strict=True)) | found[1]
    row |= evaluate(found[0], env_of_task(task)).as_row()
    versions = {
        "npend_gym": npend_gym.__version__,
        "stable_baselines3": stable_baselines3.__version__,
        "sb3_contrib": sb3_contrib.__version__,
        "torch": torch.__version__,
    }
    return row | versions | {"budget": budget, "machine": machine()}


def recorded(folder: Path, budget: float) -> list[dict[str, Any]]:
    """Return the rows of the runs in a folder; raise ValueError if one has another budget."""
    rows = {path: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    for path, row in rows.items():
        if row["budget"] != budget:
            raise ValueError(
                f"{path} has a budget of {row['budget']:g} s, not {budget:g} s: "
                "choose another folder with --out"
            )
    return list(rows.values())


def collected(folder: Path, budget: float) -> list[dict[str, Any]]:
    """Return the rows of the table in `docs/`, those of the folder in their place, in order.

    Rows in `docs/` of another budget are left out.
    """
    rows = [row | {"seed": int(row["seed"])} for row in texts(CSV)]
    rows = [row for row in rows if float(row["budget"]) == budget] + recorded(folder, budget)
    latest = {tuple(row[key] for key in KEY): row for row in rows}
    return sorted(
        latest.values(),
        key=lambda row: (TASKS.index(row["task"]), AGENTS.index(row["agent"]), row["seed"]),
    )


def tried(rows: list[dict[str, Any]]) -> list[str]:
    """Return the tasks that have rows, in order."""
    return [task for task in TASKS if any(row["task"] == task for row in rows)]


def scores(rows: list[dict[str, Any]], task: str, agent: str, column: str) -> list[float]:
    """Return what the seeds of an algorithm reached in a task."""
    return [float(row[column]) for row in rows if (row["task"], row["agent"]) == (task, agent)]


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table of success, with its means over all tasks, in Markdown."""
    tasks = tried(rows)
    titles = ["algorithm", *tasks, "mean", "interquartile mean"]
    lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for agent in AGENTS:
        cells = [agent]
        for task in tasks:
            success = scores(rows, task, agent, "success")
            seconds = scores(rows, task, agent, "seconds")
            cells.append(
                f"{100 * np.mean(success):.0f} %, {np.median(seconds):.0f} s" if success else "-"
            )
        lines.append("| " + " | ".join(cells + overall(rows, agent)) + " |")
    return "\n".join(lines) + "\n"


def success_of(rows: list[dict[str, Any]], agent: str) -> Any:
    """Return the success of an algorithm [%], (seeds, tasks), with as many seeds of each task."""
    runs = [scores(rows, task, agent, "success") for task in tried(rows)]
    count = min(map(len, runs), default=0)
    return 100.0 * np.array([each[:count] for each in runs]).T


def overall(rows: list[dict[str, Any]], agent: str) -> list[str]:
    """Return the cells of means over all tasks."""
    success = success_of(rows, agent)
    if success.size == 0:
        return ["-", "-"]
    low, high = bootstrap_interval(success)
    interval = f" ({low:.0f} to {high:.0f})" if low < high else ""
    return [f"{success.mean():.0f} %", f"{interquartile_mean(success):.0f} %{interval}"]


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the success of every run against its processor time, and that over all tasks."""
    from matplotlib.figure import Figure

    columns = -(-len(tried(rows)) // 2)
    figure: Any = Figure(figsize=(3.25 * max(columns, 3), 9.0), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=(2.0, 1.0))
    draw_runs(rows, upper.subplots(2, columns, sharex=True, sharey=True, squeeze=False))
    draw_overall(rows, lower.subplots(1, 3))
    handles = upper.axes[0].get_legend_handles_labels()
    upper.legend(*handles, loc="outside lower center", ncols=len(AGENTS) // 2)
    figure.savefig(path, dpi=110)


def draw_runs(rows: list[dict[str, Any]], panels: Any) -> None:
    """Draw the success of every run, a panel for each task."""
    tasks = tried(rows)
    marks = dict(zip(("SHAC", "imitation", *TUNED), "o^sDv", strict=True))
    for axes in panels.T.ravel()[len(tasks) :]:
        axes.set_axis_off()
    for axes, task in zip(panels.T.ravel(), tasks, strict=False):
        axes.axvline(BUDGET, color="0.8", lw=1.0)
        for k, agent in enumerate(AGENTS):
            axes.plot(
                scores(rows, task, agent, "seconds"),
                [100.0 * each for each in scores(rows, task, agent, "success")],
                marks[agent.split()[0]],
                color=f"C{k}",
                markerfacecolor="none" if agent.endswith("default") else None,
                label=agent,
            )
        axes.set(title=task, xscale="log", xlim=(1.0, 1000.0), ylim=(-5.0, 105.0))
    for axes in panels[-1]:
        axes.set_xlabel("processor time [s]")
    for axes in panels[:, 0]:
        axes.set_ylabel("success [%]")


def draw_overall(rows: list[dict[str, Any]], panels: Any) -> None:
    """Draw means with 95 % intervals as rliable does, and which share of runs succeeds by when."""
    for axes, (title, mean) in zip(panels, MEANS.items(), strict=False):
        for k, agent in enumerate(AGENTS):
            success = success_of(rows, agent)
            if success.size:
                low, high = bootstrap_interval(success, mean)
                axes.barh(k, high - low, left=low, color=f"C{k}", alpha=0.5)
                axes.plot([mean(success)] * 2, [k - 0.4, k + 0.4], color=f"C{k}", lw=2.5)
        axes.set(title=title, xlabel="success [%]", xlim=(0.0, 103.0), ylim=(len(AGENTS), -1.0))
        axes.set_yticks(range(len(AGENTS)), AGENTS if axes is panels[0] else [])
    for k, agent in enumerate(AGENTS):
        runs = [row for row in rows if row["agent"] == agent]
        times = sorted(float(row["seconds"]) for row in runs if float(row["success"]) >= SOLVED)
        share = 100.0 * np.arange(len(times) + 1) / max(1, len(runs))
        style = "--" if agent.endswith("default") else "-"
        panels[2].step(
            [1.0, *times, BUDGET], [*share, share[-1]], style, where="post", color=f"C{k}"
        )
    panels[2].set(
        title=f"runs with {100.0 * SOLVED:.0f} % success", xscale="log", xlim=(1.0, 1000.0),
        xlabel="processor time [s]", ylabel="share of runs [%]", ylim=(-3.0, 103.0),
    )  # fmt: skip


def main() -> None:
    """Train what is missing, each run into a file of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/side_by_side"))
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--agents", nargs="+", choices=AGENTS, default=list(AGENTS))
    parser.add_argument("--seeds", type=int, nargs="*", default=list(range(5)))
    parser.add_argument("--budget", type=float, default=BUDGET, help="s of processor time")
    parser.add_argument("--publish", action="store_true", help="in docs/")
    arguments = parser.parse_args()
    if arguments.budget <= 0.0:
        parser.error(f"--budget must be above 0, got {arguments.budget:g}")
    if arguments.publish and arguments.budget != BUDGET:
        parser.error(f"--publish needs --budget {BUDGET:g}, got {arguments.budget:g}")
    recorded(arguments.out, arguments.budget)  # raises before any training
    torch.set_num_threads(1)  # two are slower for networks this small
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed, task, agent in product(arguments.seeds, arguments.tasks, arguments.agents):
        path = arguments.out / f"{task}-{agent.replace(' ', '-')}-{seed}.json"
        if path.exists():
            continue
        row = run(task, agent, seed, arguments.budget)
        write_json(path, row)
        print(f"{path.stem}: {row['success']:.2f} after {row['seconds']} s", flush=True)
    rows = collected(arguments.out, arguments.budget)
    print(table(rows))
    if arguments.publish:
        write_csv(CSV, rows)
        draw(rows, FIGURE)
        publish_table(PAGE, "| algorithm |", table(rows))


if __name__ == "__main__":
    main()
