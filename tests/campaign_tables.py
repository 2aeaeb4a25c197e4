"""The tables of a campaign, read whole: for tests."""

import hashlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from npend_gym.experiments import Campaign
from npend_gym.experiments.campaign.parts import TABLES


def completed(plan, out, **workers):
    """Run a campaign to its end, with one worker where no others are given."""
    with Campaign(plan, out) as campaign:
        errors = [error for _, error in campaign.run(**({"count": 1} | workers))]
    return campaign, errors


def digests(plan, out):
    """Return the digests of the tables of a campaign."""
    return [table_digest(out, name, plan.tasks()) for name in TABLES]


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


def table_digest(out, table, tasks):
    """Return a SHA-256 of the sorted table, however it is divided into parts."""
    digests = {}
    for task in tasks:
        part = read_part(part_of(out, table, task))
        for name, column in zip(part.column_names, part.columns, strict=True):
            for what, values in (("null", column.is_null()), ("value", column.fill_null(0))):
                digest = digests.setdefault(f"{name} {what}", hashlib.sha256(name.encode()))
                digest.update(np.asarray(values).tobytes())
    joined = hashlib.sha256()
    for digest in digests.values():
        joined.update(digest.digest())
    return joined.hexdigest()
