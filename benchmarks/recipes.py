"""Whether the printed recipes for training hold: each is run with several seeds.

    python benchmarks/recipes.py --out results/recipes --publish

runs what pages print, cheapest first, and reads the success in held-out episodes from what it
prints. Each run is a JSON file in the folder, so that an interruption costs one run. `--recipes`
chooses some, `--seeds` their seeds, and `--python` the interpreter of another virtual environment.
`--publish` puts the rows into `docs/results/recipes.csv`, beside other rows, and the rates into the
page `docs/notes/recipes.md`. A run holds if at least 95 % of its held-out episodes succeed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import resource
import shlex
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

from csv_tables import merged_rows, publish_table

from npend_gym.report import write_csv, write_json
from npend_gym.tools import machine

ROOT = Path(__file__).parents[1]
CSV = ROOT / "docs" / "results" / "recipes.csv"
PAGE = ROOT / "docs" / "notes" / "recipes.md"
HEAD = "| recipe | seeds that hold | least success | time |\n"
HOLDS = 0.95  # of the held-out episodes
SB3 = "python examples/train_sb3.py {task} --seed {seed}"
EVALUATED = "python examples/{script}.py {task} --seed {seed} && npend evaluate {task}.safetensors"
# A recipe is a command, or sections of a page whose blocks are run; in the order of their time
RECIPES: dict[str, str] = {
    "tutorial": "docs/tutorial.md#A first trained policy",
    "sb3 page": "docs/howto/sb3.md#Train with Stable-Baselines3",
    "evaluate_sb3 page": "docs/howto/evaluate_sb3.md#Train,Evaluate",
    "own_trainer page": "docs/howto/own_trainer.md#Add a trainer of your own",
    "skrl": "python examples/train_skrl.py --seed {seed}",
    "many_n": "python examples/train_many_n.py --seed {seed}",
    "tianshou": "python examples/train_tianshou.py --seed {seed}",
    "npend train swingup-1": "npend train swingup-1 --seed {seed}",
    "npend train balance-1-cart": "npend train balance-1-cart --seed {seed}",
    "npend train swingup-1-cart": "npend train swingup-1-cart --seed {seed}",
    "imitation around a fit": (
        "npend identify examples/data/multiarm_double.csv --chain 'multiarm 2' --out results && "
        "npend train swingup-2 --algorithm imitation --around results/fit.json "
        "--env max_torque=0.25 --env dt=0.02 --env angle_resolution=0.003 --seed {seed}"
    ),
    "SHAC on the default cart": (
        "npend train swingup-1 --algorithm shac --env base=cart --set total_timesteps=60000 "
        "--seed {seed}"
    ),
    "train_sb3 swingup-1": SB3.format(task="swingup-1", seed="{seed}"),
    "train_sb3 swingup-1-robust": SB3.format(task="swingup-1-robust", seed="{seed}"),
    "train_sb3 balance-2": SB3.format(task="balance-2", seed="{seed}"),
    "train_sb3 calm-2-robust": SB3.format(task="calm-2-robust", seed="{seed}"),
    "npend train swingup-2": "npend train swingup-2 --algorithm shac --seed {seed}",
    "train_torchrl swingup-1": EVALUATED.format(
        script="train_torchrl", task="swingup-1", seed="{seed}"
    ),
    "SHAC for a machine": (
        "npend identify examples/data/multiarm_double.csv --chain 'multiarm 2' --out results && "
        "npend train swingup-2 --algorithm shac --env chain=results/fit.json "
        "--env max_torque=0.25 --env dt=0.02 --seed {seed}"
    ),
    "evolution strategies calm-20": EVALUATED.format(
        script="evolution_strategies", task="calm-20", seed="{seed}"
    ),
    "npend train swingup-1-robust": "npend train swingup-1-robust --seed {seed}",
    "train_sb3 swingup-1-sac": SB3.format(task="swingup-1-sac", seed="{seed}"),
    "train_sb3 balance-1-tqc": SB3.format(task="balance-1-tqc", seed="{seed}"),
    "train_sb3 calm-5": SB3.format(task="calm-5", seed="{seed}"),
    "npend train transition-2": "npend train transition-2 --seed {seed}",
    "train_sb3 swingup-2": SB3.format(task="swingup-2", seed="{seed}"),
    "npend train swingup-2-pendubot": "npend train swingup-2-pendubot --seed {seed}",
    "npend train swingup-2-robust": "npend train swingup-2-robust --seed {seed}",
    "npend train balance-2-robust": (
        "npend train balance-2-robust --algorithm imitation --env base=cart --seed {seed}"
    ),
}
PRINTED = (  # how a recipe prints its success, as a fraction, a share or a percentage
    r"success\s+(?P<met>\d+)/(?P<of>\d+)", r"'success': (?P<share>[\d.]+)", r"(?P<percent>\d+) ?%",
    r"(?P<met>\d+) of (?P<of>\d+)",
)  # fmt: skip


def code_of(page: str, seed: int) -> str:
    """Return the Python blocks of sections of a page, "FILE#Heading,Heading", with a seed."""
    file, headings = page.split("#")
    text = (ROOT / file).read_text(encoding="utf-8")
    _, *parts = re.split(r"^#+ (.*)\n", text, flags=re.MULTILINE)
    sections = dict(zip(parts[::2], parts[1::2], strict=True))
    blocks = ["import gymnasium as gym\nimport numpy as np\nimport npend_gym\n"]
    for heading in headings.split(","):
        blocks += re.findall(r"```python\n(.*?)```", sections[heading], flags=re.DOTALL)
    return re.sub(r"((?:seed(?:: int)? ?= ?)|default_rng\()0\b", rf"\g<1>{seed}", "".join(blocks))


def success_in(text: str) -> float:
    """Return the success that a recipe has printed last."""
    for pattern in PRINTED:
        if found := [each.groupdict() for each in re.finditer(pattern, text)]:
            last = {name: float(value) for name, value in found[-1].items()}
            ratio = last["met"] / last["of"] if "met" in last else None
            return last.get("share", ratio if ratio is not None else last.get("percent", 0) / 100)
    raise ValueError(f"a recipe must print its success, got {text[-500:]!r}")


def run(name: str, seed: int, python: str) -> dict[str, Any]:
    """Run a recipe in an empty folder, and return what to keep."""
    recipe = RECIPES[name]
    if recipe.startswith("docs/"):
        command = shlex.join([python, "-c", code_of(recipe, seed)])
    else:
        command = recipe.format(seed=seed).replace("npend ", f"{python} -m npend_gym ")
        command = command.replace("python examples/", f"{python} {ROOT}/examples/")
        command = command.replace(" examples/data", f" {ROOT}/examples/data")
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            command, shell=True, cwd=folder, capture_output=True, text=True, check=False,
            env=os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    failed = done.returncode != 0 and "-m npend_gym train" not in command  # 1: few succeed
    if failed or "Traceback" in done.stderr:
        raise RuntimeError(f"{name} with seed {seed} ended with {done.returncode}: {done.stderr}")
    found = {"recipe": name, "seed": seed, "success": round(success_in(done.stdout), 4)}
    return found | {"seconds": round(seconds, 1), "machine": machine()}


def table(rows: list[dict[str, Any]]) -> str:
    """Return how many seeds of each recipe hold, with its worst seed and its median time."""
    by_recipe = defaultdict(list)
    for row in rows:
        by_recipe[row["recipe"]].append((float(row["success"]), float(row["seconds"])))
    lines = [HEAD, "|---|---|---:|---:|\n"]
    for name, recipe in RECIPES.items():
        success, seconds = zip(*by_recipe.get(name, [(math.nan, math.nan)]), strict=True)
        held, shown = sum(each >= HOLDS for each in success), recipe.replace(" --seed {seed}", "")
        cells = f"{held} of {len(success)} | {min(success):.0%} | {median(seconds):.0f} s"
        lines.append(f"| `{shown}` | {cells if name in by_recipe else 'not run | |'} |\n")
    return "".join(lines)


def main() -> None:
    """Run what is missing, and print how many seeds of each recipe hold."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results/recipes"), metavar="FOLDER")
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=[*RECIPES])
    parser.add_argument("--seeds", type=int, nargs="+", default=[*range(5)])
    parser.add_argument("--python", default=sys.executable, help="interpreter of the recipes")
    parser.add_argument("--publish", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for name in arguments.recipes:
        for seed in arguments.seeds:
            path = arguments.out / f"{re.sub('[^a-z0-9]+', '-', name.lower())}-{seed}.json"
            if not path.exists():
                write_json(path, run(name, seed, arguments.python))
            rows.append(json.loads(path.read_text(encoding="utf-8")))
            print(*rows[-1].values(), flush=True)
    if arguments.publish:
        done = [row | {"seed": str(row["seed"])} for row in rows]  # as the file has it
        rows = merged_rows(CSV, done, "recipe", "seed")
        order = [*RECIPES]
        rows.sort(key=lambda row: (order.index(row["recipe"]), int(row["seed"])))
        write_csv(CSV, rows)
        publish_table(PAGE, HEAD, table(rows))
    print("".join(line for line in table(rows).splitlines(True) if "not run" not in line))


if __name__ == "__main__":
    main()
