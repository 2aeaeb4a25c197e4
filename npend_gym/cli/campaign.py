"""Sweep releases, evaluations, trainings or a function of your own, on one machine or many.

Every combination of the given values is tried `trials` times. The study is the release of chains,
or by --study evaluate, robustness, train, lyapunov, identify, or module:function, with parameters
by --set. The results are Parquet files in the folder, see docs/campaigns.md. After an interruption
the same command resumes.

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
  npend campaign --study evaluate --set policy=swingup-2 --set "damping=[0, 0.05]" -o results
  npend campaign --study lab:swing --set "gain=[1, 2, 4]" -t 100 -o s3://bucket/results
  npend campaign plan.toml -o /shared/results --shard 2/8      the second of eight shares
  npend campaign --status results                              how much is done
  npend campaign --merge results                               one file for each table
  npend campaign plan.toml -o /shared/results --slurm > job.sh
  npend analyse results
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import FAILED, INTERRUPTED, OK, printable, refuse_unused, warn
from npend_gym.cli.options import spelled

if TYPE_CHECKING:
    from npend_gym.experiments import Campaign

_SHARDS = 16
FILLS = {"npend_gym.experiments.studies.release_plan:CampaignPlan": ()}


def run(
    plan: Path | None = None,
    *,
    out: Path | str | None = None,
    study: str | None = None,
    settings: Sequence[tuple[str, Any]] = (),
    backend: str | None = None,
    address: str | None = None,
    workers: int | None = None,
    shard: str | None = None,
    status: Path | str | None = None,
    merge: Path | str | None = None,
    slurm: bool = False,
    shards: int | None = None,
    dry_run: bool = False,
    **values: Any,
) -> int:
    """Run the tasks of the campaign that are not done; return the exit code.

    Parameters
    ----------
    plan : file, optional
        A TOML, YAML or JSON file with any of these values; an option replaces the file's value.
    out : folder
        Folder of the results, or a URL such as s3://bucket/results; all machines must share it.
    study : name, optional
        What is done in a trial (default release), also module:function.
    settings : setting, optional
        A parameter of another study than release; a list is swept, and it may be repeated.
    backend : name, optional
        Local processes (loky, the default), local threads (threading), or a cluster (ray, dask).
    address : address, optional
        Address of a running Ray or Dask cluster (default: one is started on this machine).
    workers : int, optional
        Number of workers (default: one for each core).
    shard : k/n, optional
        Do only the k-th of n shares, in a command of its own on any machine.
    status : folder, optional
        Print how much of the campaign in this folder is done, with exit code 1 until it is all.
    merge : folder, optional
        Write each table of the campaign in this folder, which must be complete, as one file.
    slurm : bool
        Run nothing: write the plan into the folder, and print an array job of Slurm.
    shards : int, optional
        Number of tasks of the array job (default 16).
    dry_run : bool
        Write nothing: print the number of releases and tasks, and about how long they take.
    """
    from npend_gym.experiments import Campaign, CampaignPlan
    from npend_gym.experiments.campaign.engine import check_workers
    from npend_gym.experiments.campaign.plan_file import read_plan_file
    from npend_gym.experiments.campaign.sweep import plan_of

    if status is not None and merge is not None:
        raise ValueError("--merge must be left out with --status")
    other = {"--shard": shard, "--dry-run": dry_run, "--address": address, "--backend": backend}
    if status is not None or merge is not None:
        beside = {"PLAN": plan, "--out": out, "--study": study, "--set": settings or None} | other
        beside |= {"--slurm": slurm, "--shards": shards, "--workers": workers}
        beside |= {spelled(name): value for name, value in values.items()}
        refuse_unused(beside, "with --status and --merge, which name a folder")
        return _look(status, merge)
    if slurm:
        refuse_unused(other, "with --slurm")
    else:
        refuse_unused({"--shards": shards}, "without --slurm")
    if out is None:
        raise ValueError("--out must be given: the folder of the results")
    backend = backend or "loky"
    check_workers(backend, workers, address)
    given: dict[str, Any] = values if plan is None else read_plan_file(plan) | values
    if study is not None:
        given = given | {"study": study}
    if settings:
        given = given | {"parameters": {**given.get("parameters", {}), **dict(settings)}}
    wanted = plan_of(given) if plan is not None or given else None
    campaign = Campaign(wanted, out, shard=shard or "1/1")
    if dry_run:
        from npend_gym.experiments.studies.release_estimate import counts_text, estimate

        if isinstance(campaign.plan, CampaignPlan):
            print(estimate(campaign.plan).text(workers or os.cpu_count() or 1))
        else:
            print(counts_text(campaign.plan))
        return OK
    if slurm:
        from npend_gym.experiments.campaign.slurm import array_job

        with campaign:
            print(array_job(campaign, _SHARDS if shards is None else shards, workers or 1), end="")
        return OK
    with campaign:
        return _run(campaign, (backend, workers, address))


def _look(status: Path | str | None, merge: Path | str | None) -> int:
    """Print what is done in a folder, or merge its tables; return the exit code."""
    from npend_gym.experiments.campaign import merge as merging
    from npend_gym.report import campaign_report as report

    plan, folder, found = merging.read_status(str(merge if status is None else status))
    complete = found.count == plan.task_count
    if merge is not None:
        names = merging.merge(plan, folder, found)
        report.write_campaign_manifest(plan, folder, names, complete=complete)
        print("written:", *(printable(folder.at(name)) for name in names), sep="\n  ")
    else:
        print(f"{plan.study}: {report.status_text(plan, folder, found)}")
        print(f"{found.count} of {plan.task_count} tasks done")
    if found.text():
        warn(found.text())
    for task, error in found.failed.items():
        warn(f"task {task} failed: {error}")
    return OK if complete else FAILED


def _run(campaign: Campaign, workers: tuple[str, int | None, str | None]) -> int:
    """Run with a progress bar; return the exit code."""
    from tqdm import tqdm

    from npend_gym._progress import bar
    from npend_gym.report.campaign_report import finish

    plan, status = campaign.plan, campaign.status
    number, count = campaign.shard
    before = status.trials
    tasks = f"{plan.task_count} tasks" + (f" (shard {number}/{count})" if count > 1 else "")
    print(
        f"{plan.size} {plan.unit} of {plan.cells} cells in {tasks}, "
        f"{before} {plan.unit} done before"
    )
    if status.text():
        print(status.text(), flush=True)
    failed = 0
    code = OK
    total = plan.size if count == 1 else sum(plan.task(k).size for k in campaign.share())
    shown = bar(unit=plan.unit, total=total, initial=before)
    results = campaign.run(*workers)
    try:
        with shown:
            for task, error in results:
                if error:
                    failed += 1
                    tqdm.write(printable(f"task {task.id} failed: {error}"), file=sys.stderr)
                shown.set_postfix(failed=failed, refresh=False)
                shown.update(task.size)
    except KeyboardInterrupt:
        warn("interrupted: what is done is kept, the same command continues")
        code = INTERRUPTED
    finally:
        results.close()
    text, complete = finish(campaign)
    print(text)
    return code if code != OK or complete else FAILED
