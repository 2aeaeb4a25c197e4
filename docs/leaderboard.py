"""Write the tables of docs/leaderboard.md from the results in benchmarks/leaderboard.

Run it with `python docs/leaderboard.py`. A test compares the page with the results.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from npend_gym.rl import SUITES, BenchmarkRun, compare_benchmarks, read_benchmarks

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "leaderboard.md"
RESULTS = ROOT / "benchmarks" / "leaderboard"


def table(suite: str, runs: Sequence[BenchmarkRun]) -> str:
    """Return the table of a suite: a line for every algorithm, the best first."""
    own = [each for each in runs if each.suite == suite]
    if short := [each.name for each in own if not each.complete]:
        raise ValueError(f"each task must have 100 episodes, got fewer from {', '.join(short)}")
    tasks = list(SUITES[suite])
    titles = ["algorithm", "by", "seeds", "steps", "tasks", "mean", "IQM (95 %)", *tasks]
    rows = sorted(compare_benchmarks(own), key=lambda row: (-row["mean"], row["name"]))
    lines = [
        titles,
        ["---"] * 2 + ["---:"] * (len(titles) - 2),
        *(_line(row, [each for each in own if each.name == row["name"]], tasks) for row in rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _line(row: dict[str, Any], runs: Sequence[BenchmarkRun], tasks: Sequence[str]) -> list[str]:
    about = runs[0].record["about"]
    if any(each.record["about"] != about for each in runs):
        raise ValueError(
            f"runs of {row['name']} must all say the same of steps and by, or have another name"
        )
    steps = about.get("env_steps")
    means = (
        f"{sum(each.scores[task] for each in runs) / len(runs):.2f}"
        if any(task in each.episodes for each in runs)
        else "-"
        for task in tasks
    )
    return [
        row["name"], str(about.get("by", "")), str(row["runs"]),
        "" if steps is None else f"{steps / 1e6:.2f} M", f"{row['tasks']} of {len(tasks)}",
        f"{row['mean']:.3f}", f"{row['iqm']:.3f} ({row['low']:.3f} to {row['high']:.3f})", *means,
    ]  # fmt: skip


def with_tables(text: str) -> str:
    """Return the page with the table of each suite between its two comments."""
    runs = read_benchmarks([RESULTS])
    for suite in SUITES:
        begin, end = f"<!-- docs/leaderboard.py, {suite} -->\n", "<!-- end -->\n"
        pattern = re.compile(f"({re.escape(begin)}).*?({re.escape(end)})", re.DOTALL)
        if len(pattern.findall(text)) != 1:
            raise ValueError(f"the page must have the comments {begin}and {end}once")
        made = table(suite, runs)
        text = pattern.sub(lambda found, made=made: f"{found[1]}\n{made}\n{found[2]}", text)
    return text


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
