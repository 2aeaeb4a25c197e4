"""Release chains with every combination of parameters, on one machine or many.

Every combination of the given values is released `trials` times. The results are Parquet files in
the folder, see docs/campaigns.md. After an interruption the same command resumes.

Examples
--------
  npend campaign -o results -n 5 --trials 1000000
  npend campaign -o results -n 10,20,50 --amplitude 0.1,0.4,0.7,1.0 --trials 100
  npend campaign -o results -n 3 --masses 1,2,1:2:0.5          all 1, all 2, and 1, 2, 0.5 kg
  npend campaign -o results --chain chain.json --amplitude 0.1,0.4,0.7,1.0
  npend campaign plan.toml -o results                          n = [10, 20], trials = 100, ...
  npend campaign plan.toml -o results --dry-run                how long it would take
  npend campaign -o results                                    continue with the plan in the folder
  npend campaign plan.yaml -o /shared/results --backend ray --address auto
  npend analyse results
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import FAILED, INTERRUPTED, OK, printable, warn

if TYPE_CHECKING:
    from npend_gym.experiments import Campaign

FILLS = {"npend_gym.experiments.campaign.plan:CampaignPlan": ()}


def run(
    plan: Path | None = None,
    *,
    out: Path,
    backend: str = "loky",
    address: str | None = None,
    workers: int | None = None,
    dry_run: bool = False,
    **values: Any,
) -> int:
    """Run the tasks of the campaign that are not done; return the exit code.

    Parameters
    ----------
    plan : file, optional
        A TOML, YAML or JSON file with any of these values; an option replaces the file's value.
    out : folder
        Folder of the results; the machines of a cluster must share it.
    backend : name
        Local processes (loky), local threads (threading), or a cluster (ray, dask).
    address : address, optional
        Address of a running Ray or Dask cluster (default: one is started on this machine).
    workers : int, optional
        Number of workers (default: one for each core).
    dry_run : bool
        Write nothing: print the number of releases and tasks, and about how long they take.
    """
    from npend_gym.experiments import Campaign, CampaignPlan
    from npend_gym.experiments.campaign.engine import check_workers
    from npend_gym.experiments.campaign.plan_file import read_plan_file

    check_workers(backend, workers, address)
    given = values if plan is None else read_plan_file(plan) | values
    wanted = None if plan is None and not given else CampaignPlan.from_dict(given)
    campaign = Campaign(wanted, out)
    if dry_run:
        from npend_gym.experiments.campaign.estimate import estimate

        print(estimate(campaign.plan).text(workers or os.cpu_count() or 1))
        return OK
    with campaign:
        return _run(campaign, (backend, workers, address))


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
    shown = bar(unit="releases", total=plan.releases, initial=before)
    results = campaign.run(*workers)
    try:
        with shown:
            for task, error in results:
                if error:
                    failed += 1
                    tqdm.write(printable(f"task {task.id} failed: {error}"), file=sys.stderr)
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
