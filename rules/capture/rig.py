"""capture.rig: read a rig of rigidly mounted cameras."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.rig import Rig
from dextera_build.rule import Context, Options, rule


class RigOptions(Options):
    """capture.rig has no options."""


@rule(version=1, packages=("numpy", "pyyaml"))
def rig(ctx: Context, file: File, *, options: RigOptions) -> Rig:
    """Return the cameras of a Kalibr camchain; the frame `rig` is that of the IMU, or of the first camera."""
    found = Rig.parse(file.data, "camchain.yaml")
    ctx.say(", ".join(found.facts()))
    return found
