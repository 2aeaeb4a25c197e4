"""An array job of Slurm, each of whose tasks runs a shard of a campaign."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from npend_gym import _checks
from npend_gym.experiments.campaign.campaign import Campaign

_JOB = """\
#!/bin/bash
#SBATCH --job-name=npend-campaign
#SBATCH --array=1-{shards}
#SBATCH --cpus-per-task={workers}
#SBATCH --requeue
# Sent again, the job does what is missing. See how far it is, and then put the tables together:
#   npend campaign --status {out}
#   npend campaign --merge {out}
cd -- {here} || exit
exec {python} -m npend_gym campaign --out {out} \\
  --shard "$SLURM_ARRAY_TASK_ID/{shards}" --workers "${{SLURM_CPUS_PER_TASK:-{workers}}}"
"""


def array_job(campaign: Campaign, shards: int, workers: int) -> str:
    """Return the script of an array job for a campaign whose folder has the plan."""
    most = min(_checks.count("shards", shards, high=100_000), campaign.plan.task_count)
    out, here, python = map(shlex.quote, (str(campaign.out), str(Path.cwd()), sys.executable))
    return _JOB.format(shards=most, workers=workers, out=out, here=here, python=python)
