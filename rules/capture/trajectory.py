"""capture.trajectory: read the path of a camera or a hand from a TUM file."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.trajectory import Trajectory
from dextera_build.rule import Context, Options, rule


class TrajectoryOptions(Options):
    """Options of capture.trajectory."""

    parent: str = ""
    """Frame of the poses; empty: as stated in a comment of the file, otherwise `world`."""
    child: str = ""
    """Moving frame; empty: as stated in a comment of the file, otherwise `camera`."""


@rule(version=1, packages=("numpy",))
def trajectory(ctx: Context, file: File, *, options: TrajectoryOptions) -> Trajectory:
    """Return the poses of a TUM file: lines of stamp [s], position [m] and quaternion x y z w."""
    found = Trajectory.parse(file.data, "trajectory.txt", parent=options.parent or None, child=options.child or None)
    ctx.metric("length", found.length_m(), "m")
    ctx.say(", ".join(found.facts()))
    return found
