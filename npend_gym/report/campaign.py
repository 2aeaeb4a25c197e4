"""A campaign on paper: its manifest and what is said at its end."""

from __future__ import annotations

from npend_gym.experiments.campaign import Campaign
from npend_gym.experiments.campaign.folder import CELLS, JOURNAL, PLAN
from npend_gym.experiments.campaign.journal import read_journal
from npend_gym.report.outputs import write_manifest


def finish(campaign: Campaign) -> tuple[str, bool]:
    """Write the manifest; return what to say, and whether every task is done.

    The journal has the digests of all parts, the manifest that of the journal.
    """
    plan, out = campaign.plan, campaign.out
    records, _ = read_journal(out / JOURNAL, plan.digest)
    done = {key for key, record in records.items() if record.done}
    tasks = [task for task in plan.tasks() if task.id in done]
    releases = sum(task.releases for task in tasks)
    failed = len(records) - len(done)
    complete = len(tasks) == plan.task_count
    written = [out / name for name in (PLAN, CELLS, JOURNAL)]
    write_manifest(out, "campaign", plan.as_dict(), written, complete=complete)
    cpu = sum(records[key].cpu_s for key in done)
    text = f"{releases} of {plan.releases} releases done in {cpu:.1f} s of CPU time"
    text += f", {failed} task(s) failed" if failed else ""
    return f"{text}: {out}", complete
