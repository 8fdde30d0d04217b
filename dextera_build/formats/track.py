"""`Track` as CSV."""

from __future__ import annotations

import csv as table
import io
import math
from pathlib import Path
from typing import get_args

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.track import Status, Track
from dextera_build.formats import stamped_rows
from dextera_build.formats.files import suffix_among

_NUMBERS = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")
_COLUMNS = ("parent", "child", *_NUMBERS, "status")
_SPREAD = tuple(f"c{row}{column}" for row, column in zip(*stamped_rows.UPPER, strict=True))
"""Columns of the upper triangle of a covariance."""
_UNKNOWN = 8 * [math.nan]


def csv(track: Track) -> str:
    """A header and a row per stamp; lost poses are empty, covariances are upper triangles."""
    written = io.StringIO()
    rows = table.writer(written, lineterminator="\n")
    rows.writerow([*_COLUMNS, *(() if track.covariances is None else _SPREAD)])
    for index, status in enumerate(track.status):
        pose = track.poses[index].tolist() if status != "lost" else 7 * [""]
        spread = [] if track.covariances is None else track.covariances[index][stamped_rows.UPPER].tolist()
        rows.writerow([track.parent, track.child, float(track.stamps[index]), *pose, status, *spread])
    return written.getvalue()


def save(track: Track, path: Path) -> list[Path]:
    """Write CSV."""
    path.write_text(csv(track))
    return [path]


def load(path: str | Path) -> Track:
    """Read a CSV file with the columns that `csv` writes, in any order; those of the covariance may be missing.

    Raises:
        ArtifactError: It is no such file, or its rows are no valid track.
    """
    suffix_among("Track", Path(path), (".csv",))
    return parse(Path(path).read_bytes(), path)


def parse(data: bytes, path: str | Path) -> Track:
    """The track in the content of a CSV file that is named `path`; see `load`."""
    try:
        fields = _fields(list(table.DictReader(io.StringIO(data.decode()))))
    except (ValueError, table.Error) as error:
        raise unreadable(path, "CSV of a Track", error) from None
    return Track(**fields)


def _fields(rows: list[dict[str, str]]) -> dict[str, object]:
    missing = [name for name in _COLUMNS if not rows or name not in rows[0]]
    if missing:
        raise ValueError("it holds no row" if not rows else f"it has no column {', '.join(missing)}")
    frames = {(row["parent"], row["child"]) for row in rows}
    if len(frames) != 1:
        raise ValueError(f"it holds {len(frames)} pairs of frames; one track has one parent and one child")
    status = tuple(row["status"] for row in rows)
    unknown = sorted(set(status) - set(get_args(Status)))
    if unknown:
        raise ValueError(f"status `{unknown[0]}` is not one of {', '.join(get_args(Status))}")
    numbers = np.array([_row(number, row) for number, row in enumerate(rows, 2)])
    known = np.array([word != "lost" for word in status])
    poses = numbers[:, 1:].copy()
    poses[known] = stamped_rows.unit(poses[known])
    ((parent, child),) = frames
    names = _SPREAD if _SPREAD[0] in rows[0] else ()
    upper = np.array([[_number(number, row, name) for name in names] for number, row in enumerate(rows, 2)])
    return {
        "parent": parent,
        "child": child,
        "stamps": numbers[:, 0].copy(),
        "poses": poses,
        "status": status,
        "covariances": stamped_rows.full(upper) if names else None,
    }


def _row(line: int, row: dict[str, str]) -> list[float]:
    names = _NUMBERS[:1] if row["status"] == "lost" else _NUMBERS
    return ([_number(line, row, name) for name in names] + _UNKNOWN)[: len(_NUMBERS)]


def _number(line: int, row: dict[str, str], name: str) -> float:
    try:
        found = float(row[name] or "")
    except (KeyError, ValueError):
        found = math.nan
    if not math.isfinite(found):
        raise ValueError(f"line {line}: `{name}` is no finite number")
    return found
