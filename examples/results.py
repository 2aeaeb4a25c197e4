"""Train every task with several seeds and set the policies beside controllers and chance.

Run it with `python examples/results.py --out results/learning`; what has been trained there
already is not trained again, so it can be interrupted. `--tasks` and `--seeds` choose parts.
It writes `results.csv`, `curves.csv`, `curves.png` and the table `results.md`; `--publish` puts
them into `docs/` and the best policies into the package.
"""

from __future__ import annotations

import argparse
import csv
import re
import shutil
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import train_cleanrl
import train_es
import train_imitation
from evaluate import PLANS

from npend_gym.report.outputs import write_csv
from npend_gym.rl import controllers
from npend_gym.rl.evaluation import Agent, evaluate
from npend_gym.rl.planning import planned_swing_up
from npend_gym.rl.policies import PRETRAINED, Policy

DOCS = Path(__file__).parents[1] / "docs"
TRAINERS = {"PPO": train_cleanrl, "ES": train_es, "imitation": train_imitation}
CURVE = ("steps", "seconds", "return", "success")
ORDER = ("swingup", "balance", "calm")
TABLE = re.compile(r"\| task \| agent \|.*?\n\n", re.DOTALL)


def keywords_of(task: str) -> dict[str, Any]:
    """Return the keywords of the environment in which `task` is judged: all by default."""
    mode, n = task.rsplit("-", 1)
    return {"mode": mode, "n": int(n), "observation": "sincos"}


def yardsticks(task: str) -> dict[str, Agent]:
    """Return what a policy has to beat: chance, and controllers that know the equations."""
    keywords = keywords_of(task)
    config = gym.make("NPendulum-v0", **keywords).unwrapped.config
    joints, rng = config.joints.size, np.random.default_rng(0)
    agents: dict[str, Agent] = {
        "random": lambda observation, _: rng.uniform(-1.0, 1.0, (len(observation), joints))
    }
    if keywords["mode"] == "balance":
        agents["LQR"] = controllers.lqr(config)
    if keywords["mode"] == "calm":
        agents["modal damping"] = controllers.damper(config)
        agents["LQR"] = controllers.lqr(config, 0.0)
    if keywords["mode"] == "swingup" and config.chain.n <= 2:
        agents["energy, then LQR"] = controllers.swing_up(config)
    if keywords["mode"] == "swingup" and config.chain.n in PLANS:
        agents["plan, then LQR"] = planned_swing_up(config, **PLANS[config.chain.n])
    return agents


def tasks() -> list[str]:
    """Return all tasks for which there are settings or plans, in order."""
    named = {task for trainer in TRAINERS.values() for task in trainer.TASKS}
    named |= {f"swingup-{n}" for n in PLANS}
    return sorted(
        named, key=lambda task: (ORDER.index(task.split("-")[0]), int(task.split("-")[1]))
    )


def train_and_keep(task: str, agent: str, seed: int, out: Path) -> None:
    """Train one policy, judge it and write policy and curve down, unless they are there."""
    path, trainer = out / f"{task}-{agent}-seed{seed}.npz", TRAINERS[agent]
    if path.exists() or task not in trainer.TASKS:
        return
    policy, curve = trainer.train(trainer.settings_of(task, seed=seed), path.stem)
    score = evaluate(policy, keywords_of(task)).as_row()
    policy.provenance["evaluation"] = score
    train_cleanrl.keep(policy, curve, path)
    print(f"{path.stem}: {score}", flush=True)


def collect(tasks: list[str], out: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a row for every agent and task, and the rows of all learning curves."""
    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    blank = {"seed": "", "steps": "", "seconds": ""}
    for task in tasks:
        for name, agent in yardsticks(task).items():
            rows.append(
                {"task": task, "agent": name} | blank | evaluate(agent, keywords_of(task)).as_row()
            )
        for path in sorted(out.glob(f"{task}-*-seed*.npz")):
            policy, agent = Policy.load(path), path.stem.split("-")[2]
            seed = policy.provenance["settings"]["seed"]
            end = {key: policy.provenance["training"][key] for key in ("steps", "seconds")}
            score = evaluate(policy, keywords_of(task)).as_row()
            rows.append({"task": task, "agent": agent, "seed": seed} | end | score)
            with path.with_suffix(".csv").open(encoding="utf-8") as file:
                curves += [
                    {"task": task, "agent": agent, "seed": seed} | {key: row[key] for key in CURVE}
                    for row in csv.DictReader(file)
                ]
    return rows, curves


def table(rows: list[dict[str, Any]]) -> str:
    """Return the results as a table in Markdown, policies as the mean and range over seeds."""
    lines = ["| task | agent | seeds | steps | time | success | return | since | work |",
             "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for key in dict.fromkeys((row["task"], row["agent"]) for row in rows):
        group = [row for row in rows if (row["task"], row["agent"]) == key]
        trained = key[1] in TRAINERS
        cells = [
            key[0],
            key[1],
            str(len(group)) if trained else "",
            f"{group[0]['steps'] / 1e6:.2f} M" if trained else "",
            f"{np.mean([row['seconds'] for row in group]):.0f} s" if trained else "",
            " ".join(f"{100 * row['success']:.0f}" for row in group) + " %",
            " ".join(f"{row['return']:.0f}" for row in group),
            " ".join("-" if row["since"] is None else f"{row['since']:.1f}" for row in group)
            + " s",
            " ".join(f"{row['joules']:.0f}" for row in group) + " J",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def draw(curves: list[dict[str, Any]], path: Path) -> None:
    """Draw the share of successful training episodes against steps, a panel for every mode."""
    from matplotlib.figure import Figure

    modes = list(dict.fromkeys(row["task"].rsplit("-", 1)[0] for row in curves))
    figure = Figure(figsize=(5.0 * len(modes), 3.6), layout="constrained")
    for axes, mode in zip(figure.subplots(1, len(modes), squeeze=False)[0], modes, strict=True):
        here = [row for row in curves if row["task"].startswith(mode)]
        colors = {task: f"C{k}" for k, task in enumerate(dict.fromkeys(r["task"] for r in here))}
        for task, agent, seed in dict.fromkeys((r["task"], r["agent"], r["seed"]) for r in here):
            line = [
                row for row in here
                if (row["task"], row["agent"], row["seed"]) == (task, agent, seed)
                and row["success"]  # unknown where no episode has ended
            ]  # fmt: skip
            axes.plot(
                [float(row["steps"]) / 1e6 for row in line],
                [float(row["success"]) for row in line],
                {"PPO": "-", "ES": "--", "imitation": ":"}[agent],
                color=colors[task],
                label=f"N = {task.rsplit('-', 1)[1]}, {agent}" if seed == 0 else None,
                lw=1,
            )
        axes.set(title=mode, xlabel="environment steps [million]", ylim=(-0.02, 1.02), xscale="log")
        axes.set_xticks([0.1, 0.3, 1.0, 3.0], ["0.1", "0.3", "1", "3"])
        axes.minorticks_off()
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    figure.axes[0].set_ylabel("success of training episodes, with noise")
    figure.savefig(path, dpi=150)


def publish(rows: list[dict[str, Any]], out: Path) -> None:
    """Put tables and figure into the docs, the best policy of every task into the package."""
    for name, target in {
        "results.csv": "results/learning.csv",
        "curves.csv": "results/learning_curves.csv",
        "curves.png": "images/learning_curves.png",
    }.items():
        (DOCS / target).parent.mkdir(exist_ok=True)
        shutil.copyfile(out / name, DOCS / target)
    page = DOCS / "results.md"
    text = TABLE.sub(lambda _: table(rows) + "\n", page.read_text(encoding="utf-8"), count=1)
    page.write_text(text, encoding="utf-8")
    PRETRAINED.mkdir(exist_ok=True)
    for task in dict.fromkeys(row["task"] for row in rows):
        trained = [row for row in rows if row["task"] == task and row["agent"] in TRAINERS]
        best = max(trained, key=lambda row: (row["success"], row["return"]), default=None)
        if best and best["success"] > 0.9:
            Policy.load(out / f"{task}-{best['agent']}-seed{best['seed']}.npz").save(
                PRETRAINED / f"{task}.npz"
            )


def main() -> None:
    """Train what is missing, then write tables and figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/learning"))
    parser.add_argument("--tasks", nargs="+", default=tasks())
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--publish", action="store_true", help="in docs/ and in the package")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed in arguments.seeds:
        for task, agent in product(arguments.tasks, TRAINERS):
            train_and_keep(task, agent, seed, arguments.out)
    rows, curves = collect(arguments.tasks, arguments.out)
    write_csv(arguments.out / "results.csv", rows)
    write_csv(arguments.out / "curves.csv", curves)
    (arguments.out / "results.md").write_text(table(rows), encoding="utf-8")
    draw(curves, arguments.out / "curves.png")
    print(table(rows))
    if arguments.publish:
        publish(rows, arguments.out)


if __name__ == "__main__":
    main()
