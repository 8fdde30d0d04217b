"""`Panorama` as a `transforms.json` with a mask."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.image import Image, png
from dextera_build.artifacts.cameras.lens import Equirectangular
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.core.labels import path_fault
from dextera_build.formats import pose as pose_files
from dextera_build.formats import views as view_files

_MASK = "mask_path"
"""Field of nerfstudio's frames: a single-channel picture, black at invalid pixels."""


def save(panorama: Panorama, path: Path) -> list[Path]:
    """Write a `transforms.json`, its picture, its mask, and the pose with its covariance."""
    written = view_files.save(panorama.views(f"{path.stem}.png"), path)
    if panorama.seen is not None:
        mask = path.parent / "masks" / f"{path.stem}.png"
        mask.parent.mkdir(exist_ok=True)
        mask.write_bytes(png(panorama.seen))
        facts = json.loads(path.read_text())
        facts["frames"][0][_MASK] = mask.relative_to(path.parent).as_posix()
        path.write_text(json.dumps(facts, indent=1) + "\n")
        written.append(mask)
    return [*written, *pose_files.export(panorama.pose, path.parent, f"{path.stem}.pose")]


def load(path: str | Path) -> Panorama:
    """Read a `transforms.json` of one equirectangular picture, with its mask if it names one.

    Raises:
        ArtifactError: It is damaged, or of another kind.
    """
    views = view_files.load(path)
    if [type(views.lens(name)) for name in views.names] != [Equirectangular]:
        raise unreadable(path, "a panorama", f"it holds {len(views.names)} pictures, not one of all directions")
    name = views.names[0]
    return Panorama(image=Image(pixels=views.pixels(name)), pose=views.pose(name), seen=_seen(Path(path)))


def _seen(path: Path) -> np.ndarray | None:
    """The mask (H, W) named in a valid `transforms.json`; None if there is none."""
    from PIL import Image as Pillow

    main = path / "transforms.json" if path.is_dir() else path
    named = json.loads(main.read_text())["frames"][0].get(_MASK) if main.is_file() else None
    if named is None:
        return None
    try:
        if fault := path_fault(str(named)):
            raise ValueError(fault)
        data = (main.parent / str(named)).read_bytes()
        with Pillow.open(io.BytesIO(data), formats=("PNG",)) as picture:
            return np.asarray(picture.convert("L")) > 0
    except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
        raise unreadable(path, "a panorama", f"its mask: {error}") from None
