"""Reads a recording with Rerun's own reader, in a process of its own: `rrd_reader.py FILE.rrd OUT.pickle`."""

from __future__ import annotations

import pickle
import sys
from collections import defaultdict
from pathlib import Path

from rerun.chunk import RrdReader


def main(file: str, out: str) -> None:
    """Write every column of every entity, `/task/box Transform3D:translation`, and its times [s]."""
    columns: defaultdict[str, list[object]] = defaultdict(list)
    for chunk in RrdReader(file).stream():
        rows = chunk.to_record_batch()
        for name in rows.schema.names:
            if name == "time":
                columns[f"{chunk.entity_path} time"] += [
                    each / 1e9 for each in rows.column(name).cast("int64").to_pylist()
                ]
            elif ":" in name:
                columns[f"{chunk.entity_path} {name}"] += rows.column(name).to_pylist()
    Path(out).write_bytes(pickle.dumps(dict(columns)))


main(*sys.argv[1:])
