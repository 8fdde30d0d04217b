"""`PointCloud` as PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.point_cloud import NORMAL, RGB, XYZ, PointCloud
from dextera_build.formats.files import frame_comments, frame_of, suffix_among
from dextera_build.geometry import ply as table_files

_ROUNDING_M = 1e-4
"""Maximum rounding error of float32 coordinates [m]; map coordinates in doubles exceed it."""


def ply(cloud: PointCloud, *, text: bool = False) -> bytes:
    """A PLY file of the points, little-endian binary or ASCII; a comment names the frame."""
    columns: dict[str, np.ndarray] = dict(zip(XYZ, cloud.points.T, strict=True))
    if cloud.normals is not None:
        columns |= dict(zip(NORMAL, cloud.normals.T, strict=True))
    if cloud.colours is not None:
        columns |= dict(zip(RGB, cloud.colours.T, strict=True))
    columns |= cloud.attributes
    table = np.empty(len(cloud.points), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table_files.written(table, frame_comments(cloud.frame), text=text)


def save(cloud: PointCloud, path: Path) -> list[Path]:
    """Write a binary PLY."""
    path.write_bytes(ply(cloud))
    return [path]


def load(path: str | Path, *, frame: str | None = None) -> PointCloud:
    """Read a PLY file (binary or ASCII): coordinates [m], normals, colours, and other numbers as attributes.

    Args:
        path: The file.
        frame: Frame of its coordinates; None: as stated in a comment, otherwise "".

    Raises:
        ArtifactError: It is no PLY, has no coordinates, or they exceed float32.
    """
    suffix_among("PointCloud", Path(path), (".ply",))
    try:
        table, comments = table_files.read(Path(path).read_bytes())
        columns: dict[str, np.ndarray] = {name: table[name] for name in table.dtype.names or ()}
        points, normals, colours = _points(columns), _normals(columns), _colours(columns)
        attributes = {name: _attribute(name, column) for name, column in columns.items()}
    except (OSError, ValueError) as error:
        raise unreadable(path, "PLY", error) from None
    frame = frame_of(comments) if frame is None else frame
    return PointCloud(points=points, normals=normals, colours=colours, attributes=attributes, frame=frame)


def _taken(columns: dict[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray | None:
    """Columns by name as one array (N, 3), removed from `columns`."""
    if not all(name in columns for name in names):
        return None
    return np.stack([columns.pop(name) for name in names], axis=1)


def _points(columns: dict[str, np.ndarray]) -> np.ndarray:
    found = _taken(columns, XYZ)
    if found is None:
        raise ValueError("it has no properties `x`, `y` and `z`")
    points = found.astype(np.float32)
    error = float(np.abs(points - found.astype(np.float64)).max(initial=0))
    if error > _ROUNDING_M:
        raise ValueError(f"its coordinates are so large that float32 rounds them by {error:.2g} m; subtract an origin")
    return points


def _normals(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    found = _taken(columns, NORMAL)
    if found is None:
        return None
    length = np.linalg.norm(found.astype(np.float64), axis=1, keepdims=True)
    if (np.abs(length - 1) <= 1e-3).all():
        return found.astype(np.float32)
    return (found / np.where(length > 0, length, 1)).astype(np.float32)


def _colours(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    found = _taken(columns, RGB)
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
