"""Parts: the tables of a task as Parquet files of their own, each written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from npend_gym import _extras

pa: Any = _extras.require("pyarrow", "campaign", "campaigns")  # it has no types
pq: Any = _extras.require("pyarrow.parquet", "campaign", "campaigns")


def parquet(table: Any, about: Mapping[str, Any]) -> bytes:
    """Return a table as the bytes of a Parquet file."""
    sink = pa.BufferOutputStream()
    with writer(sink, table.schema, about) as file:
        file.write_table(table, max(len(table), 1))
    return sink.getvalue().to_pybytes()


def writer(sink: Any, schema: Any, about: Mapping[str, Any]) -> Any:
    """Return the writer of a Parquet file of this package.

    Whole numbers are packed as differences, because they repeat or count. Nothing is compressed: a
    file of a source not trusted cannot expand.
    """
    schema = schema.with_metadata({"npend_gym": json.dumps(about, sort_keys=True)})
    whole = [each.name for each in schema if pa.types.is_integer(each.type)]
    return pq.ParquetWriter(
        sink, schema, compression="none", use_dictionary=False,
        column_encoding=dict.fromkeys(whole, "DELTA_BINARY_PACKED") or None,
    )  # fmt: skip
