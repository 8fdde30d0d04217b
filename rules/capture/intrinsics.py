"""The camera of a capture folder: from `capture.json`, from a calibration's file, or from the photograph's EXIF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular
from dextera_build.errors import listing
from dextera_build.formats import lens as lens_files
from dextera_build.rule import Context

from .exif import Exif
from .facts import INTRINSICS, NAME, VIEW, camera_of, distortion_of, of_view
from .pinhole import Lens, distorted, pinhole

CALIBRATIONS = ("camera_info.yaml", "cameras.txt")
"""Calibration files that are read: ROS camera_info, COLMAP."""
FOCAL = ("fx", "fy", "cx", "cy")


def lens_of(ctx: Context, folder: Folder, facts: Mapping[str, object], tags: Exif) -> Camera | Lens:
    """The intrinsics; those in `capture.json` take precedence over other files."""
    found = _stated(ctx, folder, facts, tags)
    coefficients = distortion_of(ctx, facts) if isinstance(found, Camera) else ()
    return distorted(found, coefficients) if isinstance(found, Camera) and coefficients else found


def _stated(ctx: Context, folder: Folder, facts: Mapping[str, object], tags: Exif) -> Camera | Lens:
    """The camera without the `distortion` of `capture.json`."""
    if any(key in facts for key in FOCAL):
        return camera_of(ctx, facts)
    for name in CALIBRATIONS:
        if name in folder.files:
            return _calibrated(ctx, folder.files[name], name)
    if VIEW in facts:
        return of_view(ctx, facts, tags.upright_size)
    camera_of_exif = tags.camera()
    if camera_of_exif is not None:
        ctx.warn(
            f"no intrinsics are given: fx = fy = {camera_of_exif.fx:.0f} px is from the EXIF ({tags.source}), which is "
            f"uncertain by about 5 %, and so are all sizes across the picture; a calibration in `{NAME}` is exact"
        )
        if tags.cropped:
            ctx.warn(
                f"the picture seems to be cropped: {tags.cropped}. Then its centre is not that of the lens, and "
                f"the focal length may be wrong: use the whole picture, or state the camera in `{NAME}`"
            )
        return camera_of_exif
    if NAME not in folder.files:
        ctx.fail(
            f"`{NAME}` is missing in the capture",
            wanted=f"`{NAME}`, {' or '.join(f'`{name}`' for name in CALIBRATIONS)}, or a focal length in the EXIF",
            here=listing(folder.files),
            hint=f"put `{NAME}` into the capture's folder, with {', '.join(INTRINSICS)} in pixels, or "
            f"`{VIEW}`, the horizontal field of view",
        )
    return camera_of(ctx, facts)


def _calibrated(ctx: Context, data: bytes, name: str) -> Camera | Lens:
    found = lens_files.parse(data, Path(name))
    if isinstance(found, Equirectangular):
        ctx.fail(
            f"`{name}` is of a panorama, but a capture is a picture of a pinhole or fisheye camera",
            hint="cut a perspective picture out of the panorama first",
        )
    if isinstance(found, BrownConrady) and not found.coefficients().any():
        return pinhole(found)
    return found
