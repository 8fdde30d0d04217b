"""Files of one camera: ROS camera_info as `.yaml`, COLMAP's `cameras.txt` as `.txt`."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts import camera_info, colmap
from dextera_build.artifacts.formats import suffix_among, unreadable
from dextera_build.artifacts.intrinsics import Intrinsics

SUFFIXES = (".yaml", ".txt")
"""Of the files that `save` writes."""


def save(known: Intrinsics, path: Path) -> list[Path]:
    """Write the camera in the format of the suffix; a camera_info is named after the file."""
    text = colmap.cameras_written({1: known}) if _is_colmap(path) else camera_info.written(known, path.stem)
    path.write_text(text)
    return [path]


def load(path: Path) -> Intrinsics:
    """Read `path` in the format of its suffix.

    Raises:
        ArtifactError: It is no such file, or a `cameras.txt` with several cameras.
    """
    suffix_among("camera", path, (*SUFFIXES, ".yml"))
    return parse(path.read_bytes(), path)


def parse(data: bytes, path: Path) -> Intrinsics:
    """The camera in the content of a file that is named `path`.

    Raises:
        ArtifactError: The content is not of the format of the suffix, or contains several cameras.
    """
    form = "COLMAP cameras.txt" if _is_colmap(path) else "ROS camera_info"
    try:
        text = data.decode()
        found = list(colmap.cameras_read(text).values()) if _is_colmap(path) else [camera_info.read(text)]
        if len(found) != 1:
            raise ValueError(f"it holds {len(found)} cameras instead of one")
    except ValueError as error:
        raise unreadable(path, form, error) from None
    return found[0]


def _is_colmap(path: Path) -> bool:
    return path.suffix.lower() == ".txt"
