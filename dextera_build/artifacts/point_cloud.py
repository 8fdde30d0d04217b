"""Point clouds, with PLY as their file format."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.formats import frame_comments, frame_of, suffix_among, unreadable
from dextera_build.artifacts.image import png
from dextera_build.artifacts.pose import Pose, Similarity, check_frame
from dextera_build.errors import ArtifactError
from dextera_build.geometry import ply, transforms
from dextera_build.geometry.thumbnail import scatter

_XYZ, _NORMAL, _RGB = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")
_TAKEN = {*_XYZ, *_NORMAL, *_RGB}
_WORD = re.compile("[!-~]+")
_GREY = 0.45
_ROUNDING_M = 1e-4
"""Maximum rounding error of float32 coordinates [m]; map coordinates in doubles exceed it."""


class PointCloud(Artifact):
    """Points in space, without meaningful order."""

    saves: ClassVar[tuple[str, ...]] = (".ply",)

    points: Annotated[np.ndarray, Array("N 3", "float32", unit="m", frame="frame")]
    """Positions."""
    colours: Annotated[np.ndarray, Array("N 3", "uint8")] | None = None
    """Red, green, blue in sRGB, 0..255."""
    normals: Annotated[np.ndarray, Array("N 3", "float32", frame="frame")] | None = None
    """Unit directions out of the surface; (0, 0, 0) where unknown."""
    attributes: dict[str, Annotated[np.ndarray, Array("N", "float32")]] = Field(default_factory=dict)
    """Name -> further numbers of every point: `confidence`, `intensity`."""
    frame: str = Field("", pattern="^[ -~]*$")
    """Frame of the coordinates; "" if not stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.normals is not None:
            length = np.linalg.norm(self.normals.astype(np.float64), axis=1)
            wrong = int(((np.abs(length - 1) > 1e-3) & (length > 0)).sum())
            if wrong:
                raise ArtifactError(
                    f"PointCloud.normals: {wrong:,} of {len(length):,} are of another length than 1",
                    code="DXB-A403",
                    hint="divide each by its length, or write (0, 0, 0) where the normal is unknown",
                )
        for name in self.attributes:
            if name in _TAKEN or not _WORD.fullmatch(name):
                raise ArtifactError(
                    f"PointCloud.attributes: {name!r} is no free name of a PLY property",
                    code="DXB-A404",
                    hint="a name is printable ASCII without spaces, and not that of a coordinate, normal or colour",
                )
        return self

    def facts(self) -> Iterator[str]:
        """Number of points, extent, and available properties."""
        yield f"{len(self.points):,} points"
        if len(self.points):
            yield " x ".join(f"{1000 * length:.0f}" for length in np.ptp(self.points, axis=0)) + " mm"
        yield from (name for name in ("colours", "normals") if getattr(self, name) is not None)
        yield from self.attributes
        if self.frame:
            yield f"frame {self.frame}"

    def picture(self) -> bytes:
        """The points from their front left and above."""
        grey = np.full((len(self.points), 3), _GREY)
        return png(scatter(self.points, grey if self.colours is None else self.colours / 255))

    def moved(self, motion: Pose | Similarity) -> PointCloud:
        """The same points in the parent frame of `motion`.

        Raises:
            ArtifactError: The cloud's frame is not its child.
        """
        check_frame(self.name(), self.frame, motion)
        scale = motion.scale if isinstance(motion, Similarity) else 1.0
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        fields["points"] = transforms.apply(motion.matrix, scale * self.points.astype(np.float64)).astype(np.float32)
        if self.normals is not None:
            fields["normals"] = (self.normals @ motion.matrix[:3, :3].T).astype(np.float32)
        return PointCloud(**fields | {"frame": motion.parent})

    def ply(self, *, text: bool = False) -> bytes:
        """A PLY file of the points, little-endian binary or ASCII; a comment names the frame."""
        columns: dict[str, np.ndarray] = dict(zip(_XYZ, self.points.T, strict=True))
        if self.normals is not None:
            columns |= dict(zip(_NORMAL, self.normals.T, strict=True))
        if self.colours is not None:
            columns |= dict(zip(_RGB, self.colours.T, strict=True))
        columns |= self.attributes
        table = np.empty(len(self.points), [(name, column.dtype) for name, column in columns.items()])
        for name, column in columns.items():
            table[name] = column
        return ply.written(table, frame_comments(self.frame), text=text)

    def _write(self, path: Path) -> list[Path]:
        path.write_bytes(self.ply())
        return [path]

    @classmethod
    def load(cls, path: str | Path, *, frame: str | None = None) -> PointCloud:
        """Read a PLY file (binary or ASCII): coordinates [m], normals, colours, and other numbers as attributes.

        Args:
            path: The file.
            frame: Frame of its coordinates; None: as stated in a comment, otherwise "".

        Raises:
            ArtifactError: It is no PLY, has no coordinates, or they exceed float32.
        """
        suffix_among(cls.name(), Path(path), cls.saves)
        try:
            table, comments = ply.read(Path(path).read_bytes())
            columns: dict[str, np.ndarray] = {name: table[name] for name in table.dtype.names or ()}
            points, normals, colours = _points(columns), _normals(columns), _colours(columns)
            attributes = {name: _attribute(name, column) for name, column in columns.items()}
        except (OSError, ValueError) as error:
            raise unreadable(path, "PLY", error) from None
        frame = frame_of(comments) if frame is None else frame
        return cls(points=points, normals=normals, colours=colours, attributes=attributes, frame=frame)


def _taken(columns: dict[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray | None:
    """Columns by name as one array (N, 3), removed from `columns`."""
    if not all(name in columns for name in names):
        return None
    return np.stack([columns.pop(name) for name in names], axis=1)


def _points(columns: dict[str, np.ndarray]) -> np.ndarray:
    found = _taken(columns, _XYZ)
    if found is None:
        raise ValueError("it has no properties `x`, `y` and `z`")
    points = found.astype(np.float32)
    error = float(np.abs(points - found.astype(np.float64)).max(initial=0))
    if error > _ROUNDING_M:
        raise ValueError(f"its coordinates are so large that float32 rounds them by {error:.2g} m; subtract an origin")
    return points


def _normals(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    found = _taken(columns, _NORMAL)
    if found is None:
        return None
    length = np.linalg.norm(found.astype(np.float64), axis=1, keepdims=True)
    if (np.abs(length - 1) <= 1e-3).all():
        return found.astype(np.float32)
    return (found / np.where(length > 0, length, 1)).astype(np.float32)


def _colours(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    found = _taken(columns, _RGB)
    if found is None or found.dtype == np.uint8:
        return found
    if found.dtype.kind == "f" and found.min(initial=0) >= 0 and found.max(initial=0) <= 1:
        return np.round(255 * found).astype(np.uint8)
    if found.dtype == np.uint16:
        return np.round(found / 257).astype(np.uint8)
    raise ValueError(f"its colours are neither bytes nor numbers from 0 to 1, but {found.dtype}")


def _attribute(name: str, column: np.ndarray) -> np.ndarray:
    numbers = column.astype(np.float32)
    if column.dtype.kind != "f" and not np.array_equal(numbers.astype(np.float64), column.astype(np.float64)):
        raise ValueError(f"property `{name}` holds whole numbers that float32 cannot hold")
    return numbers
