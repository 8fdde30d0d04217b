"""The file formats of each type: which module writes and reads them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.formats import parts
from dextera_build.formats.files import no_format, suffix_among

T = TypeVar("T")


class Format(NamedTuple):
    """How a type is written."""

    module: str
    """Module of `formats` with `save(value, path)`, and `load(path, ...)` if it is read, too."""
    saves: tuple[str, ...]
    """Suffixes of the files that `save` writes, the preferred one first."""


_CAMERA = Format("lens", (".yaml", ".txt"))
FILES = {
    "BrownConrady": _CAMERA,
    "Calibration": Format("calibration", (".yaml",)),
    "Camera": _CAMERA,
    "DepthImage": Format("image", (".png",)),
    "Equirectangular": Format("lens", (".txt",)),
    "Film": Format("film", (".mp4",)),
    "HandStream": Format("hand_stream", (".mcap",)),
    "Image": Format("image", (".png",)),
    "KannalaBrandt": _CAMERA,
    "MaskTrack": Format("mask_track", (".zip",)),
    "Mesh": Format("mesh", (".obj", ".glb", ".ply", ".stl", ".usda", ".usdc", ".usd", ".usdz")),
    "Panorama": Format("panorama", (".json",)),
    "PointCloud": Format("point_cloud", (".ply",)),
    "RgbdVideo": Format("rgbd_video", (".zip",)),
    "Rig": Format("rig", (".yaml",)),
    "Splats": Format("splats", (".ply", ".splat", ".spz", ".usda", ".usdc", ".usd", ".usdz")),
    "Stream": Format("mcap", (".mcap",)),
    "Table": Format("table", (".csv",)),
    "Track": Format("track", (".csv",)),
    "Trajectory": Format("trajectory", (".txt",)),
    "Video": Format("video", (".mp4",)),
    "Views": Format("views", (".json",)),
}
"""Type -> its format as one file."""
FOLDERS = {
    "Capture": "capture",
    "Film": "film",
    "Pose": "pose",
    "Scene": "scene",
    "Similarity": "pose",
    "TaskBundle": "task",
    "Views": "views",
}
"""Type -> the module whose `export(value, folder, stem)` writes it to a folder; others are written as one file."""


def suffixes(kind: type[Artifact]) -> tuple[str, ...]:
    """Suffixes of the files in which a type can be saved, the preferred one first."""
    form = _of(FILES, kind)
    return kind.saves if form is None else form.saves


def save(value: Artifact, path: Path) -> list[Path]:
    """Write a value as one file; see `Artifact.save`."""
    kind = type(value)
    suffix_among(value.name(), path, suffixes(kind))
    path.parent.mkdir(parents=True, exist_ok=True)
    module = _module(kind)
    written: list[Path] = value._write(path) if module is None else module.save(value, path)
    return written


def load(kind: type[Artifact], path: Path, **options: Any) -> Artifact:
    """Read a file; see `Artifact.load`."""
    read = getattr(_module(kind), "load", None)
    if read is None:
        raise no_format(kind.name(), path, ())
    found: Artifact = read(path, **options)
    if not isinstance(found, kind):
        raise unreadable(path, f"a {kind.name()}", f"it holds a {found.name()}")
    return found


def export(value: Artifact, folder: Path, stem: str) -> list[Path]:
    """Write a value to a folder; see `Artifact.export`."""
    kind = type(value)
    folder.mkdir(parents=True, exist_ok=True)
    writer = _of(FOLDERS, kind)
    if writer is not None:
        written: list[Path] = _imported(writer).export(value, folder, stem)
        return written
    forms = suffixes(kind)
    return value.save(folder / f"{stem}{forms[0]}") if forms else parts.export(value, folder, stem)


def _module(kind: type[Artifact]) -> ModuleType | None:
    form = _of(FILES, kind)
    return None if form is None else _imported(form.module)


def _imported(name: str) -> ModuleType:
    return import_module(f"dextera_build.formats.{name}")


def _of(table: Mapping[str, T], kind: type[Artifact]) -> T | None:
    """The entry of a type of dxb; None for a type of a project, whatever its name."""
    return table.get(kind.name()) if kind.__module__.startswith("dextera_build.") else None
