"""`TaskBundle` as one file for Gymnasium, beside the files of its parts."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats import parts


def export(bundle: TaskBundle, folder: Path, stem: str) -> list[Path]:
    """Write every part in its own format, and the whole as `stem.bundle`, which `gymnasium.make` accepts."""
    path = folder / f"{stem}.bundle"
    written = [*parts.export(bundle, folder, stem), path]
    path.write_bytes(pack(bundle))
    return written
