"""capture.lens: read a camera's calibrated lens from the file that a calibration program wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dextera_build.artifacts import camera_files
from dextera_build.artifacts import lens as lens_files
from dextera_build.artifacts.base import File
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.rule import Context, Options, rule


class LensOptions(Options):
    """Options of capture.lens."""

    form: Literal["ros", "colmap"] = "ros"
    """`ros`: camera_info as YAML; `colmap`: a `cameras.txt` with one camera."""


@rule(version=1, packages=("numpy", "pyyaml"))
def lens(ctx: Context, file: File, *, options: LensOptions) -> Camera | BrownConrady | KannalaBrandt | Equirectangular:
    """Return the camera in a ROS camera_info or a COLMAP `cameras.txt`, with integer pixel centres [px]."""
    name = Path("cameras.txt" if options.form == "colmap" else "camera_info.yaml")
    found = lens_files.of(camera_files.parse(file.data, name))
    ctx.say(", ".join(found.facts()))
    return found
