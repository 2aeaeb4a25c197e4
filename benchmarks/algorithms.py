"""Train every task with several seeds and compare the policies with controllers and with chance.

Run it with `python benchmarks/algorithms.py --out results/learning`; what has been trained there
already is not trained again, so it can be interrupted. `--tasks`, `--agents` and `--seeds` choose
parts of it.
It writes `results.csv` and the table `results.md`, and `curves.csv` and `curves.png` if there are
trained policies; `--publish` puts them into `docs/` and the best policies into the package.

`--again` trains nothing: it renews the rows in `docs/` that need no training, which are those of
chance, of the controllers and of the policies of the package.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import numpy as np
from csv_tables import publish_table, read_rows, texts

from npend_gym.report import write_csv
from npend_gym.rl import (
    PLANS,
    PRETRAINED,
    VALIDATION,
    Controller,
    Policy,
    bootstrap_interval,
    evaluate,
    interquartile_mean,
    pretrained_names,
    recovery,
    reference_controller,
    robustness,
)
from npend_gym.rl.training import env_of_task, imitation, shac

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
ES = SimpleNamespace(**run_path(str(ROOT / "examples" / "evolution_strategies.py"), {}, "es"))
TRAINERS: dict[str, Any] = {"SHAC": shac, "imitation": imitation, "ES": ES}
STYLES = {"SHAC": "-", "ES": "--", "imitation": ":"}
CURVE = ("steps", "seconds", "return", "success")
ORDER = ("swingup", "transition", "balance", "calm")
LABELS = {
    "damping": "modal damping", "LQR": "LQR", "energy": "energy, then LQR",
    "plan": "plan, then LQR", "MPC": "MPC",
}  # fmt: skip
# on carts, for which controllers are compared
POLES = {"swingup": range(1, 7), "balance": range(1, 6)}
REFERENCES = tuple(LABELS.values())


def references(task: str) -> dict[str, Controller]:
    """Return what a policy is compared with: chance, and controllers that know the equations."""
    keywords, rng = env_of_task(task), np.random.default_rng(0)
    mode, n = keywords["mode"], keywords["n"]
    plans = POLES["swingup"] if "base" in keywords else PLANS
    names = {
        "balance": ["LQR"],
        "calm": ["damping", "LQR"],
        "transition": ["plan"],
        # with more rods MPC takes many minutes
        "swingup": ["energy"] * (n <= 2) + ["plan"] * (n in plans) + ["MPC"] * (n <= 3),
    }[mode]
    found: dict[str, Controller] = {
        "random": lambda observation, _: rng.uniform(-1.0, 1.0, (len(observation), 1))
    }
    return found | {LABELS[name]: reference_controller(name, keywords) for name in names}


def tasks() -> list[str]:
    """Return all tasks for which there are settings or plans, in order."""
    named = {
        task for trainer in TRAINERS.values() for task in trainer.TASKS
        if trainer is not imitation or "robust" not in task  # which robustness.py judges
    }  # fmt: skip
    on_carts = {f"{mode}-{n}-cart" for mode, poles in POLES.items() for n in poles}
    return sorted(named | {f"swingup-{n}" for n in PLANS} | on_carts, key=place)


def place(task: str) -> tuple[int, int, str]:
    """Return where a task stands in the tables."""
    mode, n, *_ = task.split("-")
    return ORDER.index(mode), int(n), task


def task_name(task: str) -> str:
    """Return the name of a task; raise ValueError if the tables have no place for it."""
    env_of_task(task)
    place(task)
    return task


def train_and_keep(task: str, agent: str, seed: int, out: Path) -> None:
    """Train one policy, evaluate it and write policy and curve, unless they exist already."""
    path, trainer = out / f"{task}-{agent}-seed{seed}.safetensors", TRAINERS[agent]
    if path.exists() or task not in trainer.TASKS:
        return
    policy, curve = trainer.train(trainer.settings_of(task, seed=seed), path.stem)
    write_csv(path.with_suffix(".csv"), curve)
    held_out = evaluate(policy, policy.env).as_row()
    policy.provenance["evaluation"] = held_out
    policy.save(path)
    print(f"{path.stem}: {held_out}", flush=True)


def evaluated(task: str, agent: str, controller: Controller) -> dict[str, Any]:
    """Return the row of a controller that is not trained here."""
    row = {"task": task, "agent": agent, "seed": "", "steps": "", "seconds": "", "clock": ""}
    return row | evaluate(controller, env_of_task(task)).as_row()


def renewed(rows: list[dict[str, Any]], tasks: list[str]) -> list[dict[str, Any]]:
    """Return recorded rows; those of `tasks` evaluated again, unless they need a training run."""
    known: dict[tuple[Any, ...], Controller] = {}
    for task in tasks:
        known |= {(task, name, None, None): agent for name, agent in references(task).items()}
        if task in pretrained_names():
            about = (policy := Policy.pretrained(task)).provenance
            # a policy with other settings than those of its task has other steps
            known[task, trainer_of(policy), about["seed"], about["training"]["steps"]] = policy
    keys = [(row["task"], row["agent"], row["seed"], row["steps"]) for row in rows]
    envs = {key: getattr(agent, "env", env_of_task(key[0])) for key, agent in known.items()}
    return [
        row | evaluate(known[key], envs[key]).as_row() if key in known else row
        for key, row in zip(keys, rows, strict=True)
    ]


def trainer_of(policy: Policy) -> str:
    """Return which of `TRAINERS` a policy comes from."""
    names = {"shac": "SHAC", "imitation": "imitation", ES.SCRIPT: "ES"}
    return names.get(policy.provenance["trained_by"], "")


def recorded(name: str = "learning") -> list[dict[str, Any]]:
    """Return the rows of the table in `docs/`, or of its learning curves."""
    return read_rows(DOCS / "results" / f"{name}.csv")


def merged(rows: list[dict[str, Any]], name: str) -> list[dict[str, Any]]:
    """Return new rows together with those that `docs/` has of others and other seeds, in order."""
    order = ["random", *REFERENCES, *sorted(TRAINERS)]

    def rank(row: dict[str, Any]) -> tuple[Any, ...]:
        return *place(row["task"]), order.index(row["agent"]), row["seed"] or 0

    new = {rank(row) for row in rows}
    kept = [row for row in recorded(name) if rank(row) not in new]
    return sorted([*kept, *rows], key=rank)


def collect(tasks: list[str], out: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a row for every agent and task, and the rows of all learning curves."""
    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    for task in tasks:
        rows += [evaluated(task, name, agent) for name, agent in references(task).items()]
        runs = [
            (agent, path)
            for agent in sorted(TRAINERS)
            for path in sorted(out.glob(f"{task}-{agent}-seed*.safetensors"))
        ]
        for agent, path in runs:
            run = {"task": task, "agent": agent, "seed": int(path.stem.rpartition("-seed")[2])}
            curve = texts(path.with_suffix(".csv"))
            curves += [run | {key: row.get(key, "") for key in CURVE} for row in curve]
            policy = Policy.load(path)
            end = {"steps": int(curve[-1]["steps"]), "seconds": float(curve[-1]["seconds"])}
            end["clock"] = policy.provenance["clock"].removesuffix(" time")
            rows.append(run | end | evaluate(policy, policy.env).as_row())
    return rows, curves


def table(rows: list[dict[str, Any]]) -> str:
    """Return the results as a table in Markdown, a line for every task and what learned it."""
    titles = ("task", "controllers that know the equations", "learned by", "seeds", "steps",
              "time", "success", "settling time")  # fmt: skip
    lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for task in dict.fromkeys(row["task"] for row in rows):
        here = [row for row in rows if row["task"] == task]
        known = [
            f"{row['agent'].replace(',', '')}: {100 * row['success']:.0f} %"
            for row in here if row["agent"] in REFERENCES
        ]  # fmt: skip
        cells = [task, ", ".join(known)]
        agents = dict.fromkeys(row["agent"] for row in here if row["agent"] in TRAINERS)
        for agent in agents:
            cells += learned([row for row in here if row["agent"] == agent])
            lines.append("| " + " | ".join(cells) + " |")
            cells = [""] * 2
        if not agents:
            lines.append("| " + " | ".join(cells + [""] * 6) + " |")
    return "\n".join(lines) + "\n"


def learned(runs: list[dict[str, Any]]) -> list[str]:
    """Return the cells of one algorithm: the median time, and of success what rliable reports."""
    success = 100.0 * np.array([[row["success"]] for row in runs])
    middle, (low, high) = interquartile_mean(success), bootstrap_interval(success)
    times = [row["settling_time"] for row in runs if row["settling_time"] is not None]
    return [
        runs[0]["agent"],
        str(len(runs)),
        f"{runs[0]['steps'] / 1e6:.2f} M",
        f"{np.median([row['seconds'] for row in runs]):.0f} s",
        f"{middle:.0f} %" + f" ({low:.0f} to {high:.0f})" * (low < high),
        f"{np.mean(times):.1f} s" if times else "-",
    ]


def draw(curves: list[dict[str, Any]], path: Path) -> None:
    """Draw the success rate of the training episodes against steps, a panel for every mode."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    modes = list(dict.fromkeys(row["task"].split("-")[0] for row in curves))
    figure = Figure(figsize=(5.0 * len(modes), 3.6), layout="constrained")
    for axes, mode in zip(figure.subplots(1, len(modes), squeeze=False)[0], modes, strict=True):
        here = [row for row in curves if row["task"].startswith(mode)]
        order = dict.fromkeys(row["task"] for row in here)
        colors = {task: colormaps["tab20"](k) for k, task in enumerate(order)}
        named: set[str] = set()
        for task, agent, seed in dict.fromkeys((r["task"], r["agent"], r["seed"]) for r in here):
            name = f"N = {', '.join(task.split('-')[1:])}, {agent}"
            line = [
                row for row in here
                if (row["task"], row["agent"], row["seed"]) == (task, agent, seed)
                and row["success"] not in ("", None)  # unknown where no episode has ended
            ]  # fmt: skip
            axes.plot(
                [float(row["steps"]) / 1e6 for row in line],
                [float(row["success"]) for row in line],
                STYLES[agent],
                color=colors[task],
                label=None if name in named else name,
                lw=1,
            )
            named.add(name)
        axes.set(title=mode, xlabel="environment steps [million]", ylim=(-0.02, 1.02), xscale="log")
        axes.set_xticks([0.01, 0.1, 1.0, 10.0], ["0.01", "0.1", "1", "10"])
        axes.minorticks_off()
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    figure.axes[0].set_ylabel("success of training episodes, with noise")
    figure.savefig(path, dpi=150)


def publish_rows(rows: list[dict[str, Any]]) -> None:
    """Put the rows into `docs/`, as CSV and as a table."""
    write_csv(DOCS / "results" / "learning.csv", rows)
    publish_table(DOCS / "results.md", "| task | controllers", table(rows))


def publish(rows: list[dict[str, Any]], curves: list[dict[str, Any]], out: Path) -> None:
    """Put the results into `docs/`, and the best policy of every task into the package."""
    publish_rows(merged(rows, "learning"))
    curves = merged(curves, "learning_curves")
    write_csv(DOCS / "results" / "learning_curves.csv", curves)
    draw(curves, DOCS / "images" / "learning_curves.png")
    PRETRAINED.mkdir(exist_ok=True)
    for task in dict.fromkeys(row["task"] for row in rows):
        trained = [row for row in rows if row["task"] == task and row["agent"] in TRAINERS]
        policies = [
            Policy.load(out / f"{task}-{r['agent']}-seed{r['seed']}.safetensors") for r in trained
        ]
        shipped = Policy.pretrained(task) if task in pretrained_names() else None
        candidates = [shipped, *policies] if shipped else policies
        scores = [score(task, policy) for policy in candidates]
        best = max(range(len(scores)), key=scores.__getitem__, default=None)
        if best is not None and candidates[best] is not shipped and scores[best][0] > 0.9:
            candidates[best].save(PRETRAINED / f"{task}.safetensors")


def score(task: str, policy: Policy) -> tuple[float, float, int]:
    """Return success, robustness and rounded return of a policy in validation episodes.

    Where the task is to recover, `recovery` takes the place of robustness.
    """
    evaluation = evaluate(policy, policy.env, episodes=400, seed=VALIDATION)
    nominal = {name: value for name, value in policy.env.items() if name != "randomize"}
    judge = recovery if "recovery" in task else robustness
    survived = judge(policy, nominal, seed=VALIDATION).score
    return evaluation.success_rate, survived, round(float(evaluation.returns.mean()))


def main() -> None:
    """Train what is missing, then write the tables and the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/learning"))
    parser.add_argument("--tasks", nargs="+", type=task_name, default=tasks())
    parser.add_argument("--agents", nargs="+", choices=TRAINERS, default=list(TRAINERS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--publish", action="store_true", help="in docs/ and in the package")
    parser.add_argument("--again", action="store_true", help="evaluate, train nothing")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.again:
        publish_rows(renewed(recorded(), arguments.tasks))
        return
    for seed in arguments.seeds:
        for task, agent in product(arguments.tasks, arguments.agents):
            train_and_keep(task, agent, seed, arguments.out)
    rows, curves = collect(arguments.tasks, arguments.out)
    write_csv(arguments.out / "results.csv", rows)
    (arguments.out / "results.md").write_text(table(rows), encoding="utf-8")
    if curves:
        write_csv(arguments.out / "curves.csv", curves)
        draw(curves, arguments.out / "curves.png")
    print(table(rows))
    if arguments.publish:
        publish(rows, curves, arguments.out)


if __name__ == "__main__":
    main()
