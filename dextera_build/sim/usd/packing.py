"""A written stage as text, as USD's binary form, or as one `.usdz` file with its textures; all of them byte-stable."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal, TypeAlias

from dextera_build.artifacts.base import Folder

Form: TypeAlias = Literal["usda", "usdc", "usdz"]
"""Suffix of a stage."""
_STAMP = 315_619_200
"""Time of the files in a package: 2 January 1980, in every time zone a date that a zip file can hold [s]."""


def main(folder: Folder) -> str:
    """Name of the stage in a folder: `scene` with one of the suffixes; empty if there is none."""
    return next((name for name in folder.files if Path(name).stem == "scene" and name.startswith("scene.usd")), "")


def packed(folder: Folder, form: Form, scratch: Path) -> Folder:
    """The folder of `writer.write` in another form.

    Args:
        folder: `scene.usda` and `textures/*.png`.
        form: `usdz` puts everything into one file, its binary stage first.
        scratch: An existing scratch folder.
    """
    from pxr import Sdf

    if form == "usda":
        return folder
    place = scratch / "packed"
    place.mkdir()
    folder.export(place, "scene")
    stage = place / "scene.usdc"
    Sdf.Layer.FindOrOpen(str(place / "scene.usda")).Export(str(stage))
    others = {name: data for name, data in folder.files.items() if name != "scene.usda"}
    if form == "usdc":
        return Folder(files={"scene.usdc": stage.read_bytes(), **others})
    return Folder(files={"scene.usdz": _zipped(place, [stage.name, *others])})


def _zipped(place: Path, names: list[str]) -> bytes:
    """A package: stored, aligned to 64 bytes, the first name its root layer."""
    from pxr import Sdf

    package = place / "scene.usdz"
    writer = Sdf.ZipFileWriter.CreateNew(str(package))
    for name in names:
        os.utime(place / name, (_STAMP, _STAMP))
        writer.AddFile(str(place / name), name)
    writer.Save()
    return package.read_bytes()
