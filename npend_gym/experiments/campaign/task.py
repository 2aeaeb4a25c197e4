"""One task, as a worker runs it: measured, and its parts written."""

from __future__ import annotations

from npend_gym._provenance import provenance
from npend_gym.experiments.campaign.folder import Folder
from npend_gym.experiments.campaign.parts import parquet
from npend_gym.experiments.campaign.tasks import Plan, Task


def run_task(plan: Plan, folder: Folder, task: Task) -> str | OSError:
    """Measure a task and write its parts; return nothing, or the error.

    An error in the measurement is returned as a text, so that the other tasks continue; one of the
    disk, which is no fault of the task, as it is.
    """
    try:
        tables = plan.measure(task)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is told
        return f"{type(error).__name__}: {error}"
    about = provenance({"plan": plan.digest, "study": plan.study, "task": task.id}, plan.seed)
    try:
        for name in plan.tables:
            data = parquet(tables[name], about)
            folder.write_part(plan.digest, f"{name}/{task.place}", data, ".parquet")
        names = [folder.names(f"{name}/{task.place}-") for name in plan.tables]
    except OSError as error:
        return error
    return next((differing(task, each) for each in names if len(each) > 1), "")


def differing(task: Task, names: list[str]) -> str:
    """Return the error of a task of which parts with other bytes exist."""
    return (
        f"task {task.id} has several results, {' and '.join(names)}: the study must return the "
        "same table whenever it runs. Remove the wrong file and run the campaign again"
    )
