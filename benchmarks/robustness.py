"""How often policies succeed with other chains than they were made for, trained on many or on one.

Run it with `python benchmarks/robustness.py`: it plays `swingup-1`, `calm-2` and their robust
versions with other chains. They are drawn from the whole range of training, stand at its corners,
or differ in one parameter. It also plays `swingup-2` to `swingup-5` and their robust versions under
errors that neither their training nor the criteria of `robustness` have. It prints two tables and
writes `robustness.csv`, `unseen_errors.csv` and a figure, `robustness.png`; `--publish` puts them
into `docs/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from algorithms import DOCS
from csv_tables import publish_table
from gymnasium.wrappers.vector import TransformAction, TransformObservation
from tqdm import tqdm

from npend_gym.report import styled, write_csv
from npend_gym.rl import Policy, evaluate, setting_of
from npend_gym.rl.training import ROBUST, env_of_task
from npend_gym.tools import BLUE, FAINT, ORANGE

TASKS = ("swingup-1", "calm-2")
FACTORED = ("masses", "lengths", "gravity", "max_torque")  # of ROBUST; damping has values
FACTORS = [round(0.1 * tenth, 1) for tenth in range(5, 16)]
LONGER = [f"swingup-{n}{kind}" for kind in ("", "-robust") for n in range(2, 6)]
PAGE = DOCS / "notes" / "randomized_training.md"
UNSEEN_PAGE = DOCS / "notes" / "robust_policies.md"
NOMINAL, WHOLE, LOW, HIGH = "as made", "drawn from the whole range", "all low", "all high"
DAMPED = f"damping {ROBUST['damping']['high']}"
TOGETHER = "all of them, half as large"


def ends(name: str) -> tuple[float, float]:
    """Return the ends of the range of a parameter in training."""
    given = ROBUST[name]
    return (given["low"], given["high"]) if isinstance(given, dict) else tuple(given)


def fixed(name: str, value: Any) -> dict[str, Any]:
    """Return the keyword `randomize` that always gives a parameter this factor, or value."""
    always = (value, value) if name in FACTORED else {"low": value, "high": value}
    return {name: always}


def cases(n: int) -> dict[str, dict[str, Any]]:
    """Return the keyword `randomize` of every case, by its name."""
    found: dict[str, dict[str, Any]] = {NOMINAL: {}, WHOLE: ROBUST}
    for name, factor in product(FACTORED, FACTORS):
        found[f"{name} x {factor}"] = fixed(name, factor)
    found[DAMPED] = fixed("damping", ends("damping")[1])
    for name in FACTORED[:2] if n == 2 else ():
        for pair in (list(ends(name)), list(ends(name))[::-1]):
            found[f"{name} x {pair[0]} and {pair[1]}"] = fixed(name, pair)
    return found | corners()


def corners() -> dict[str, dict[str, Any]]:
    """Return the keyword `randomize` of each corner of the whole range, by its name."""
    found: dict[str, dict[str, Any]] = {}
    for values in product(*map(ends, ROBUST)):
        at = dict(zip(ROBUST, values, strict=True))
        label = ", ".join(f"{name} {value}" for name, value in at.items())
        found[label] = {k: v for name, value in at.items() for k, v in fixed(name, value).items()}
    first, *_, last = found
    return {{first: LOW, last: HIGH}.get(label, label): found[label] for label in found}


def unseen(task: str, size: float = 0.5) -> dict[str, dict[str, Any]]:
    """Return each error that neither training nor criteria have, as arguments of `env_with`.

    `size` is over the largest error of the criteria that is most like it. Parameters of the chain
    are wrong by a quarter there, angles by 0.02 rad, torques by 11/60 of the limit, and damping is
    0.1 N m s/rad. Pulses have peaks from 1/12 to 5/6 of the limit, with 11/24 in the middle. That a
    mass or length is wrong for all rods is in the training.
    """
    config = setting_of(env_of_task(task)).config
    noise, push = 11.0 / 60.0 * size, 11.0 / 12.0 * size * config.max_torque
    pushes = {"push_rate": 0.3, "push_force": push / config.chain.total_length}
    every: dict[str, dict[str, Any]] = {
        "gravity": {"gravity": (1.0 - 0.25 * size, 1.0 + 0.25 * size)},
        "air drag": fixed("drag", 0.1 * size),  # N s/m, at each bob
        "inertia of motors": fixed("armature", 0.25 * size),  # kg m^2, at each joint
        "torque ripple": fixed("torque_ripple", noise * config.max_torque),
        "pushes at the tip": {
            k: w for name in pushes for k, w in fixed(name, pushes[name]).items()
        },
    }
    return {name: {"randomize": given} for name, given in every.items()} | {
        "weaker in one direction": {"weaker": 0.25 * size},
        "coarse torques": {"coarse": noise},  # standard deviation of their rounding
        "offset of the angles": {"offset": 0.02 * size},
    }


def unseen_cases(task: str) -> dict[str, dict[str, Any]]:
    """Return the arguments of `env_with` of every error alone, and of all at half their size."""
    halves = unseen(task, 0.25).values()
    drawn = {k: w for each in halves for k, w in each.get("randomize", {}).items()}
    others = {name: value for each in halves for name, value in each.items()}
    return {NOMINAL: {}} | unseen(task) | {TOGETHER: others | {"randomize": drawn}}


def env_with(
    env: dict[str, Any], weaker: float = 0.0, coarse: float = 0.0, offset: float = 0.0, **more: Any
) -> Any:
    """Return an environment with more keywords, and errors of motor and sensors."""
    if not (weaker or coarse or offset):
        return env | more
    envs = setting_of(env | more).make(1)
    n, step = envs.unwrapped.config.n, 12.0**0.5 * coarse

    def exerted(action: Any) -> Any:
        levels = np.round(action / step) * step if step else action
        return np.where(levels > 0.0, 1.0 - weaker, 1.0) * levels

    def shown(observation: Any) -> Any:
        s, c, rest = np.split(observation, (n, 2 * n), axis=-1)
        turned = s * np.cos(offset) + c * np.sin(offset), c * np.cos(offset) - s * np.sin(offset)
        return np.concatenate([*turned, rest], axis=-1, dtype=np.float32)

    return TransformAction(TransformObservation(envs, shown), exerted)


def measure(
    plays: Iterable[tuple[str, str, dict[str, Any]]], episodes: int
) -> list[dict[str, Any]]:
    """Return a row for every policy, case and error, of episodes that neither trained nor chose."""
    rows: list[dict[str, Any]] = []
    for name, case, given in tqdm([*plays], disable=None, unit="case"):
        policy = Policy.pretrained(name)
        row = evaluate(policy, env_with(policy.env, **given), episodes=episodes).as_row()
        kept = {key: row[key] for key in ("episodes", "success", "return")}
        rows.append({"policy": name, "case": case} | kept)
    return rows


def success_of(rows: list[dict[str, Any]]) -> dict[tuple[str, str], float]:
    """Return the success rates by policy and case."""
    return {(row["policy"], row["case"]): row["success"] for row in rows}


def unseen_table(rows: list[dict[str, Any]]) -> str:
    """Return the success of the longer chains under unseen errors, as a table in Markdown."""
    success = success_of(rows)
    titles = ["error", *LONGER]
    lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    kinds = list(dict.fromkeys(case for _, case in success))
    found = {case: [success[policy, case] for policy in LONGER] for case in kinds}
    found["mean of the errors"] = np.mean([found[case] for case in kinds[1:]], axis=0)
    for case, rates in found.items():
        lines.append(f"| {case} | {' | '.join(f'{100.0 * rate:.0f} %' for rate in rates)} |")
    return "\n".join(lines) + "\n"


def table(rows: list[dict[str, Any]]) -> str:
    """Return the success of all policies at the ends of the ranges, as a table in Markdown."""
    success = success_of(rows)
    policies = list(dict.fromkeys(policy for policy, _ in success))
    shown = [NOMINAL, WHOLE]
    shown += [f"{name} x {end}" for name in FACTORED for end in ends(name)] + [DAMPED]
    shown += [case for case in cases(2) if " and " in case] + [LOW, HIGH]
    lines = [f"| chain | {' | '.join(policies)} |", "|---" * (len(policies) + 1) + "|"]
    for case in shown:
        rates = [success.get((policy, case)) for policy in policies]
        cells = ["" if rate is None else f"{100.0 * rate:.0f} %" for rate in rates]
        lines.append(f"| {case} | {' | '.join(cells)} |")
    at_corners = [[success[policy, case] for case in corners()] for policy in policies]
    for label, summary in (("mean of the 32 corners", np.mean), ("worst corner", np.min)):
        cells = [f"{100.0 * summary(rates):.0f} %" for rates in at_corners]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


@styled
def figure(rows: list[dict[str, Any]]) -> Any:
    """Draw success against the factor of a parameter, a row of panels for each task."""
    from matplotlib.figure import Figure

    success = success_of(rows)
    drawn = Figure(figsize=(8.6, 4.2))
    grid = drawn.subplots(len(TASKS), len(FACTORED), sharex=True, sharey=True)
    for axes, (task, name) in zip(grid.flat, product(TASKS, FACTORED), strict=True):
        axes.axvspan(*ends(name), color=FAINT, alpha=0.3, linewidth=0.0)
        for policy, color, mark in ((task, ORANGE, "s--"), (f"{task}-robust", BLUE, "o-")):
            rates = [100.0 * success[policy, f"{name} x {factor}"] for factor in FACTORS]
            axes.plot(FACTORS, rates, mark, color=color, markersize=3.5, label=policy)
        axes.set(ylim=(-5.0, 105.0), xticks=(0.5, 0.8, 1.0, 1.2, 1.5))
    for axes, name in zip(grid[0], FACTORED, strict=True):
        axes.set_title(name)
    for axes in grid[-1]:
        axes.set_xlabel("factor")
    for axes in grid[:, 0]:
        axes.set_ylabel("success [%]")
    for axes in grid[:, FACTORED.index("gravity")]:  # where the lines leave room
        axes.legend(loc="center")
    return drawn


def main() -> None:
    """Play, and write the tables and the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/robustness"))
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--publish", action="store_true", help="in docs/")
    arguments = parser.parse_args()
    chains = [(task, name, given) for task in TASKS
              for name, given in cases(env_of_task(task)["n"]).items()]  # fmt: skip
    both = [(name, case, {"randomize": given}) for task, case, given in chains
            for name in (task, f"{task}-robust")]  # fmt: skip
    longer = [(name, case, given) for name in LONGER
              for case, given in unseen_cases(name.removesuffix("-robust")).items()]  # fmt: skip
    rows, others = (measure(plays, arguments.episodes) for plays in (both, longer))
    folder, picture = arguments.out, arguments.out / "robustness.png"
    if arguments.publish:
        folder, picture = DOCS / "results", DOCS / "images" / "robustness.png"
        publish_table(PAGE, "| chain |", table(rows))
        publish_table(UNSEEN_PAGE, "| error |", unseen_table(others))
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / "robustness.csv", rows)
    write_csv(folder / "unseen_errors.csv", others)
    figure(rows).savefig(picture)
    print(table(rows), unseen_table(others), sep="\n")


if __name__ == "__main__":
    main()
