"""Write the tables of the policies that ship, from the records of the policies.

Run it with `python docs/shipped_policies.py`. The tables stand between two comments in README.md,
docs/results.md and docs/tasks/carts.md. A test compares them with what the records say.
"""

from __future__ import annotations

import csv
import re
from functools import partial
from pathlib import Path
from typing import Any

from npend_gym.rl import Policy, pretrained_names

ROOT = Path(__file__).parents[1]
ALGORITHMS = {
    "evolution_strategies": "evolution strategies",
    "shac": "SHAC",
    "imitation": "imitation",
}
ORDER = ("swingup", "transition", "balance", "calm")
SWING_UP, TRANSITION = "`npend/SwingUp-v1`, `n=1`", "`npend/Transition-v1`, `n=2`"
# Of the README: environment, what is to be done, name of the policy
TASKS = (
    (SWING_UP, "from hanging to standing, with a motor at the pivot", "swingup-1"),
    *((f"`n={n}`", "", f"swingup-{n}") for n in range(2, 7)),
    (TRANSITION, "from any of 4 equilibria to any other", "transition-2"),
    ("`n=3`", "from any of 8", "transition-3"),
    ("`npend/Balance-v1`, `n=3`", "stay upright", "balance-3"),
    ("`npend/Calm-v1`, `n=20`", "bring a released chain to rest", "calm-20"),
    ("`npend/CartTriplePole-v1`", "keep three poles upright on a cart", "balance-3-cart"),
    ('`npend/CartDoublePole-v1`, `mode="swingup"`', "swing up two poles", "swingup-2-cart"),
    (
        "`npend/SwingUp-v1`, `**policy.env`",
        "`swingup-6-cart`: six such poles, 20 N, 3 m to each side",
        "swingup-6-cart",
    ),
    (
        "`npend/Transition-v1`, `**policy.env`",
        "`transition-3-cart`: three poles on a cart",
        "transition-3-cart",
    ),
    ("`npend/Release-v1`", "none: the free release is measured", ""),
)
CONTROLLERS = ("modal damping", "LQR", "energy, then LQR", "plan, then LQR", "MPC")


def record(name: str) -> dict[str, Any]:
    """Return what the record of a policy that ships says, under the same names for all."""
    about = Policy.pretrained(name).provenance
    members = about.get("members", [])
    algorithm = ALGORITHMS[Path(about["trained_by"]).stem]
    if members:
        algorithm += f", mean of {len(members)}"
    evaluation = about["evaluation"]
    settling = evaluation.get("settling_time", evaluation.get("since"))
    return {
        "algorithm": algorithm,
        "seed": ", ".join(str(made["seed"]) for made in members or [about]),
        "steps": f"{about['training']['steps'] / 1e6:.2f} M",
        "time": f"{about['training']['seconds']:.0f} s",
        "success": f"{100 * evaluation['success']:.0f} %",
        "settling": f"{settling:.1f} s",
    }


def successes(task: str) -> dict[str, float]:
    """Return the success of controllers, as docs/results/learning.csv has it."""
    with (ROOT / "docs" / "results" / "learning.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["task"] == task]
    return {row["agent"]: float(row["success"]) for row in rows if row["agent"] in CONTROLLERS}


def controllers(task: str) -> str:
    """Return the controllers that succeed most often."""
    found = successes(task)
    if not found:
        return ""
    best = [name.replace(",", "") for name in found if found[name] == max(found.values())]
    return f"{', '.join(best)} {100 * max(found.values()):.0f} %"


def table(titles: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def of_readme() -> str:
    """Return the table of the README: a line for every task."""
    titles = ["`gym.make(...)`", "task", "policy by", "one core", "success",
              "by a controller that knows the equations"]  # fmt: skip
    rows = list[list[str]]()
    for env, task, name in TASKS:
        shipped = record(name) if name in pretrained_names() else None
        cells = ["", "", ""]
        if shipped:
            cells = [shipped["algorithm"], shipped["time"], shipped["success"]]
        rows.append([env, task, *cells, controllers(name)])
    return table(titles, rows)


def of_results() -> str:
    """Return the table of docs/results.md: a line for every policy."""
    names = sorted(
        pretrained_names(),
        key=lambda name: (ORDER.index(name.split("-")[0]), int(name.split("-")[1]), name),
    )
    titles = ["policy", "learned by", "seed", "steps", "time", "success", "settling time"]
    return table(titles, [[name, *record(name).values()] for name in names])


def of_cart(*poles: int) -> str:
    """Return the table of the page of the carts: a line for each task with so many poles."""
    titles = ["task", "controllers that know the equations", "policy by", "time", "success"]
    rows = list[list[str]]()
    for name in (f"{mode}-{n}-cart" for n in poles for mode in ("balance", "swingup")):
        known = [f"{who.replace(',', '')}: {100 * x:.0f} %" for who, x in successes(name).items()]
        shipped = record(name) if name in pretrained_names() else {}
        if not (known or shipped):
            continue
        cells = [shipped.get(key, "") for key in ("algorithm", "time", "success")]
        rows.append([name, ", ".join(known), *cells])
    return table(titles, rows)


TABLES = {
    "README.md": of_readme,
    "docs/results.md": of_results,
    "docs/tasks/carts.md": partial(of_cart, 1, 2, 3, 4, 5, 6),
}


def with_table(text: str, made: str) -> str:
    """Return a page with `made` between its two comments."""
    begin, end = "<!-- docs/shipped_policies.py -->\n", "<!-- end -->\n"
    pattern = re.compile(f"({re.escape(begin)}).*?({re.escape(end)})", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise ValueError(f"the page must have the comments {begin}and {end}once")
    return pattern.sub(lambda found: f"{found[1]}\n{made}\n{found[2]}", text)


def main() -> None:
    """Write all tables."""
    for name, made in TABLES.items():
        path = ROOT / name
        path.write_text(with_table(path.read_text(encoding="utf-8"), made()), encoding="utf-8")


if __name__ == "__main__":
    main()
