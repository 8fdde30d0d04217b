"""Parquet files for LeRobot's loader, complete in memory."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .lerobot_features import Feature

INDEX = "task"
"""Column of `meta/tasks.parquet` that pandas uses as the index."""
PICTURE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
"""An encoded picture, as `datasets` stores it."""
Columns = Mapping[str, np.ndarray | list[bytes]]
"""What the steps of an episode hold, by feature."""


def steps(features: dict[str, Feature], episodes: list[Columns]) -> bytes:
    """A data file: one row per step, one row group per episode.

    Args:
        features: Features of numbers.
        episodes: Numbers (T, N) by feature, and encoded pictures of T steps by names that are not in `features`.
    """
    pictures = [name for name in episodes[0] if name not in features]
    kinds = [(name, _kind(feature)) for name, feature in features.items()]
    schema = pa.schema(kinds + [(name, PICTURE) for name in pictures])
    if pictures:
        # By this entry, `datasets` decodes them.
        known = {"info": {"features": {name: {"_type": "Image"} for name in pictures}}}
        schema = schema.with_metadata({"huggingface": json.dumps(known)})
    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(sink, schema, compression="snappy") as writer:
        for columns in episodes:
            arrays = [_array(feature, columns[name]) for name, feature in features.items()]
            arrays += [pa.array([{"bytes": each} for each in columns[name]], PICTURE) for name in pictures]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
    return bytes(sink.getvalue())


def episodes(rows: list[dict[str, object]]) -> bytes:
    """`meta/episodes`: one row per episode."""
    return _file(pa.table({name: [row[name] for row in rows] for name in rows[0]}))


def tasks(words: str) -> bytes:
    """`meta/tasks.parquet`: task texts as a pandas index, and task numbers."""
    table = pa.table({"task_index": pa.array([0], pa.int64()), INDEX: pa.array([words])})
    column = {"metadata": None}
    pandas = {
        "index_columns": [INDEX],
        "column_indexes": [],
        "columns": [
            column | {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
            column | {"name": INDEX, "field_name": INDEX, "pandas_type": "unicode", "numpy_type": "object"},
        ],
        "pandas_version": "2.3.0",
    }
    return _file(table.replace_schema_metadata({"pandas": json.dumps(pandas)}))


def _file(table: Any) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="snappy")
    return bytes(sink.getvalue())


def _kind(feature: Feature) -> Any:
    scalar = pa.bool_() if feature.dtype == "bool" else pa.from_numpy_dtype(np.dtype(feature.dtype))
    # LeRobot reads a one-component feature as a number, not a list.
    return scalar if feature.width == 1 else pa.list_(scalar, feature.width)


def _array(feature: Feature, values: np.ndarray | list[bytes]) -> Any:
    flat = pa.array(np.ascontiguousarray(values, feature.dtype).ravel())
    return flat if feature.width == 1 else pa.FixedSizeListArray.from_arrays(flat, feature.width)
