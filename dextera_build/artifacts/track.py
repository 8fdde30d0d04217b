"""Poses of an object over time, with CSV as file format."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts import stamped
from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.formats import suffix_among, unreadable
from dextera_build.artifacts.image import png
from dextera_build.errors import ArtifactError
from dextera_build.geometry.plot import COLOURS, Line, plot

Status = Literal["tracked", "predicted", "lost"]
_NUMBERS = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")
_COLUMNS = ("parent", "child", *_NUMBERS, "status")
_SPREAD = tuple(f"c{row}{column}" for row, column in zip(*stamped.UPPER, strict=True))
"""Columns of the upper triangle of a covariance."""
_UNKNOWN = 8 * [math.nan]


class Track(Artifact):
    """Poses of an object in a frame, one per picture or measurement, including those at which it is lost."""

    saves: ClassVar[tuple[str, ...]] = (".csv",)

    parent: str = Field(pattern=r"^\S+$")
    """Frame that the poses are in."""
    child: str = Field(pattern=r"^\S+$")
    """The object."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times, increasing."""
    poses: Annotated[np.ndarray, Array("N 7", "float64", unit="m", frame="parent", finite=False)]
    """T_parent_child: position, and unit quaternion w x y z; NaN where it is lost."""
    status: tuple[Status, ...]
    """Per stamp: `tracked`, measured; `predicted`, extrapolated without a measurement; `lost`, no pose."""
    covariances: Annotated[np.ndarray, Array("N 6 6", "float64", frame="parent")] | None = None
    """Covariance of translation [m] and rotation vector [rad], see `geometry.uncertainty`; zeros where it is lost."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = np.array([status != "lost" for status in self.status], bool)
        if len(known) != len(self.stamps) or not len(known):
            raise ArtifactError(
                f"Track: {len(known)} statuses for {len(self.stamps)} stamps; both need as many, and at least one",
                code="DXB-A505",
            )
        there = np.isfinite(self.poses).all(axis=1)
        if (there != known).any() or not np.isnan(self.poses[~known]).all():
            wrong = int(np.flatnonzero((there != known) | (~known & ~np.isnan(self.poses).all(axis=1)))[0])
            raise ArtifactError(
                f"Track: the pose at {self.stamps[wrong]} s does not fit its status `{self.status[wrong]}`",
                code="DXB-A506",
                hint="a lost pose is NaN throughout, and any other one is finite",
            )
        stamped.check(self.name(), self.stamps, self.poses, self.covariances)
        return self

    def facts(self) -> Iterator[str]:
        """Frames, number of poses, and how many of each status."""
        yield f"T_{self.parent}_{self.child}"
        yield f"{len(self.stamps):,} stamps"
        yield f"{self.stamps[-1] - self.stamps[0]:.2f} s"
        yield from (f"{self.status.count(kind):,} {kind}" for kind in get_args(Status) if kind in self.status)

    def picture(self) -> bytes:
        """x, y and z over time in blue, orange and green; gaps where it was lost."""
        lines = [Line(np.stack([self.stamps, self.poses[:, axis]], axis=1), COLOURS[axis]) for axis in range(3)]
        return png(plot(lines, "t [s]", "[m]"))

    def csv(self) -> str:
        """A header and a row per stamp; lost poses are empty, covariances are upper triangles."""
        written = io.StringIO()
        rows = csv.writer(written, lineterminator="\n")
        rows.writerow([*_COLUMNS, *(() if self.covariances is None else _SPREAD)])
        for index, status in enumerate(self.status):
            pose = self.poses[index].tolist() if status != "lost" else 7 * [""]
            spread = [] if self.covariances is None else self.covariances[index][stamped.UPPER].tolist()
            rows.writerow([self.parent, self.child, float(self.stamps[index]), *pose, status, *spread])
        return written.getvalue()

    def _write(self, path: Path) -> list[Path]:
        path.write_text(self.csv())
        return [path]

    @classmethod
    def load(cls, path: str | Path) -> Track:
        """Read a CSV file with the columns that `csv` writes, in any order; those of the covariance may be missing.

        Raises:
            ArtifactError: It is no such file, or its rows are no valid track.
        """
        suffix_among(cls.name(), Path(path), cls.saves)
        return cls.parse(Path(path).read_bytes(), path)

    @classmethod
    def parse(cls, data: bytes, path: str | Path) -> Track:
        """The track in the content of a CSV file that is named `path`; see `load`."""
        try:
            fields = _fields(list(csv.DictReader(io.StringIO(data.decode()))))
        except (ValueError, csv.Error) as error:
            raise unreadable(path, "CSV of a Track", error) from None
        return cls(**fields)


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
    poses[known] = stamped.unit(poses[known])
    ((parent, child),) = frames
    names = _SPREAD if _SPREAD[0] in rows[0] else ()
    upper = np.array([[_number(number, row, name) for name in names] for number, row in enumerate(rows, 2)])
    return {
        "parent": parent,
        "child": child,
        "stamps": numbers[:, 0].copy(),
        "poses": poses,
        "status": status,
        "covariances": stamped.full(upper) if names else None,
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
