"""capture.calibration: read a hand-eye calibration from the file of a ROS package."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.calibration import Calibration
from dextera_build.rule import Context, Options, rule


class CalibrationOptions(Options):
    """capture.calibration has no options."""


@rule(version=1, packages=("numpy", "pyyaml"))
def calibration(
    ctx: Context, file: File, camera_info: File | None = None, *, options: CalibrationOptions
) -> Calibration:
    """Return the calibration in a file of easy_handeye or easy_handeye2, with intrinsics of a ROS camera_info."""
    found = Calibration.parse(file.data, "calibration.yaml", None if camera_info is None else camera_info.data)
    ctx.say(", ".join(found.facts()))
    return found
