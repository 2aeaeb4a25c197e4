"""The tables of a campaign, read whole: for tests."""

import hashlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from npend_gym.experiments import Campaign
from npend_gym.experiments.studies.release_plan import BOBS, RELEASES


def completed(plan, out, **workers):
    """Run a campaign to its end, with one worker where no others are given."""
    with Campaign(plan, out) as campaign:
        errors = [error for _, error in campaign.run(**({"count": 1} | workers))]
    return campaign, errors


def digests(plan, out):
    """Return a SHA-256 of each table of a campaign, however it is divided into parts."""
    return [table_digest(read_table(out, name, plan.tasks())) for name in (RELEASES, BOBS)]


def part_of(out, table, task):
    """Return the path of a task's part of a table."""
    (path,) = (out / table).glob(f"{task.place}-*.parquet")
    return path


def read_part(path):
    """Return a part as a pyarrow table, without the columns that its path stands for."""
    return pq.ParquetFile(path).read()


def read_table(out, table, tasks):
    """Return the parts of `tasks` as one pyarrow table, sorted by cell, trial and bob."""
    return pa.concat_tables([read_part(part_of(out, table, task)) for task in tasks])


def table_digest(table):
    """Return a SHA-256 of the names, nulls and values of all columns."""
    digest = hashlib.sha256()
    for name, column in zip(table.column_names, table.columns, strict=True):
        digest.update(name.encode())
        for values in (column.is_null(), column.fill_null(0)):
            digest.update(np.asarray(values).tobytes())
    return digest.hexdigest()
