"""`npend campaign`: the release experiment swept at scale."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    CHAIN_OPTION,
    FAILED,
    INTERRUPTED,
    OK,
    angles,
    integers,
    printable,
    warn,
)

if TYPE_CHECKING:
    from npend_gym.experiments import Campaign, CampaignPlan

ABOUT = """\
Chains with every combination of the given values are released, `trials` times each. The results are
Parquet files in the folder, see docs/campaigns.md. However it ended, the same command continues it.
"""
EXAMPLES = """\
examples:
  npend campaign --out results --n 5 --trials 1000000
  npend campaign --out results --n 10,20,50 --amplitude 0.1,0.4,0.7,1.0 --trials 100
  npend campaign --out results --n 3 --masses 1,2,1:2:0.5      all 1, all 2, and 1, 2, 0.5 kg
  npend campaign --out results --chain chain.json --amplitude 0.1,0.4,0.7,1.0
  npend campaign plan.toml --out results                       n = [10, 20], trials = 100, ...
  npend campaign plan.toml --out results --dry-run             how long it would take
  npend campaign --out results                                 continue with the plan in the folder
  npend campaign plan.yaml --out /shared/results --backend ray --address auto
  npend analyse results
"""


def _listed(kind: Any, name: str) -> Any:
    def values(text: str) -> list[Any]:
        return [kind(part) for part in text.split(",")]

    values.__name__ = f"list of {name}"  # for error messages
    return values


def _per_rod(text: str) -> float | list[float]:
    parts = [float(part) for part in text.split(":")]
    return parts if len(parts) > 1 else parts[0]


_NUMBERS = _listed(float, "numbers")
_PER_ROD = _listed(_per_rod, "numbers, or of numbers for each rod joined by colons")

# Option, type, placeholder, help; the option is the plan's name
_OPTIONS = (
    ("n", integers, "N,...", "numbers of pendulums (default 5,10,20,100)"),
    ("masses", _PER_ROD, "KG[:KG...],...", "masses: one for all bobs, or one for each (default 1)"),
    ("lengths", _PER_ROD, "M[:M...],...", "lengths: one for all rods, or one for each (default 1)"),
    ("gravity", _NUMBERS, "M/S2,...", "accelerations of gravity (default 9.81)"),
    ("damping", _NUMBERS, "NMS,...", "viscous dampings of every joint (default 0)"),
    (
        "reading",
        _listed(str, "readings"),
        "NAME,...",
        "when a pseudo-period ends (default bob)",
    ),
    (
        "amplitude",
        angles,
        "RAD,...",
        "starting angles of all rods; 60deg are degrees (default pi/4)",
    ),
    ("spread", angles, "RAD,...", "a trial adds one random angle from [0, RAD) (default 0.017)"),
    ("trials", int, "COUNT", "releases of each combination (default 3)"),
    ("seed", int, "SEED", "seed of the random angles (default 0)"),
    ("duration", float, "S", "longest time of a trial (default: until all bobs have completed)"),
    ("batch", int, "COUNT", "releases in a task (default: about a second of work)"),
    CHAIN_OPTION[1:],
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend campaign`."""
    text = "a TOML, YAML or JSON file with any of these values; an option replaces the file's value"
    parser.add_argument("plan", type=Path, nargs="?", default=None, metavar="FILE", help=text)
    text = "folder of the results; the machines of a cluster must share it"
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help=text)
    for name, kind, placeholder, text in _OPTIONS:
        parser.add_argument(f"--{name}", type=kind, metavar=placeholder, help=text)
    text = "loky: local processes; threading: local threads; ray, dask: a cluster (default loky)"
    parser.add_argument("--backend", metavar="NAME", help=text)
    text = "address of a running Ray or Dask cluster (default: one is started on this machine)"
    parser.add_argument("--address", help=text)
    text = "number of workers (default: one for each core)"
    parser.add_argument("--workers", type=int, metavar="COUNT", help=text)
    text = "write nothing: print the number of releases and tasks, and about how long they take"
    parser.add_argument("--dry-run", dest="dry_run", action="store_true", help=text)


def run(options: dict[str, Any]) -> int:
    """Run the tasks of the campaign that are not done; return the exit code."""
    from npend_gym.experiments import Campaign
    from npend_gym.experiments.campaign.engine import check_workers

    workers = options.get("backend", "loky"), options.get("workers"), options.get("address")
    check_workers(*workers)
    if options.get("dry_run"):
        from npend_gym.experiments.campaign.estimate import estimate

        plan = Campaign(_plan(options), options["out"]).plan
        print(estimate(plan).text(workers[1] or os.cpu_count() or 1))
        return OK
    with Campaign(_plan(options), options["out"]) as campaign, _sigterm_interrupts():
        return _run(campaign, workers)


def _plan(options: dict[str, Any]) -> CampaignPlan | None:
    """Return the plan of the file and the options; None where there are neither."""
    from npend_gym.experiments import CampaignPlan
    from npend_gym.experiments.campaign.plan_file import read_plan_file

    path: Path | None = options["plan"]
    values = {} if path is None else read_plan_file(path)
    values |= {name: options[name] for name, *_ in _OPTIONS if name in options}
    return CampaignPlan.from_dict(values) if values or path is not None else None


def _run(campaign: Campaign, workers: tuple[str, int | None, str | None]) -> int:
    """Run with a progress bar; return the exit code."""
    from tqdm import tqdm

    from npend_gym._progress import bar
    from npend_gym.report.campaign_report import finish

    plan, status = campaign.plan, campaign.status
    before = sum(task.releases for task in plan.tasks() if task.id in status.done)
    print(
        f"{plan.releases} releases of {plan.cells} cells in {plan.task_count} tasks, "
        f"{before} releases done before"
    )
    if status.text():
        print(status.text(), flush=True)
    failed = 0
    code = OK
    shown = bar(unit="release", total=plan.releases, initial=before)
    results = campaign.run(*workers)
    try:
        with shown:
            for task, record in results:
                if not record.done:
                    failed += 1
                    tqdm.write(printable(f"task {task.id} failed: {record.error}"), file=sys.stderr)
                shown.set_postfix(failed=failed, refresh=False)
                shown.update(task.releases)
    except KeyboardInterrupt:
        warn("interrupted: what is done is kept, the same command continues")
        code = INTERRUPTED
    finally:
        results.close()
    text, complete = finish(campaign)
    print(text)
    return code if code != OK or complete else FAILED


@contextmanager
def _sigterm_interrupts() -> Generator[None, None, None]:
    """Treat SIGTERM, by which clusters end a job, as Ctrl-C."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
