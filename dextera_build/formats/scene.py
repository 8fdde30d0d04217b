"""`Scene` as the files of its MuJoCo model."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.scenes.scene import Scene


def export(scene: Scene, folder: Path, stem: str) -> list[Path]:
    """Write `scene.xml` and its files."""
    return scene.model.export(folder, stem)
