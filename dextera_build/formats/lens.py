"""Cameras as ROS camera_info (`.yaml`) or COLMAP's `cameras.txt` (`.txt`)."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt, Lens
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.formats import camera_info, colmap
from dextera_build.formats.files import suffix_among
from dextera_build.formats.intrinsics import Intrinsics


def save(lens: Lens, path: Path) -> list[Path]:
    """Write the camera in the format of the suffix; a camera_info is named after the file."""
    known = numbers(lens)
    text = colmap.cameras_written({1: known}) if _is_colmap(path) else camera_info.written(known, path.stem)
    path.write_text(text)
    return [path]


def load(path: str | Path) -> Lens:
    """Read a camera from a ROS camera_info (`.yaml`, `.yml`) or a COLMAP `cameras.txt` with one camera.

    Raises:
        ArtifactError: The file is neither, or contains several cameras.
    """
    path = Path(path)
    suffix_among("camera", path, (".yaml", ".txt", ".yml"))
    return parse(path.read_bytes(), path)


def parse(data: bytes, path: Path) -> Lens:
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
    return of(found[0])


def numbers(lens: Lens) -> Intrinsics:
    """The numbers of a camera."""
    if isinstance(lens, Equirectangular):
        return Intrinsics("equirectangular", lens.width, lens.height)
    base = (lens.width, lens.height, (lens.fx, lens.fy), (lens.cx, lens.cy))
    if isinstance(lens, Camera):
        return Intrinsics("pinhole", *base)
    k = tuple(lens.coefficients().tolist())
    return Intrinsics("brown_conrady" if isinstance(lens, BrownConrady) else "kannala_brandt", *base, k)


def of(known: Intrinsics) -> Lens:
    """The lens with these numbers.

    Raises:
        ArtifactError: They are no valid camera: a focal length is not above 0.
    """
    size = {"width": known.width, "height": known.height}
    if known.model == "equirectangular":
        return Equirectangular(**size)
    (fx, fy), (cx, cy) = known.focal, known.centre
    base = {**size, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    if known.model == "pinhole":
        return Camera(**base)
    names: tuple[str, ...] = ("k1", "k2", "k3", "k4")
    if known.model == "kannala_brandt":
        return KannalaBrandt(**base, **dict(zip(names, known.coefficients, strict=True)))
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return BrownConrady(**base, **dict(zip(names, known.coefficients, strict=True)))


def _is_colmap(path: Path) -> bool:
    return path.suffix.lower() == ".txt"
