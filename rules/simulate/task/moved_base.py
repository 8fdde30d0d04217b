"""simulate.moved_base: a task with the robot's base at its calibrated pose."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import transforms
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.model import compose


class MovedBaseOptions(Options):
    """Options of simulate.moved_base."""

    most_m: PositiveFloat = 0.10
    """Distance from the task's original base above which a warning is given [m]."""
    most_deg: PositiveFloat = 10.0
    """The same for its rotation [deg]."""


@rule(version=1, packages=("numpy",))
def moved_base(ctx: Context, bundle: TaskBundle, base: Pose, *, options: MovedBaseOptions | None = None) -> TaskBundle:
    """Return the same task with the robot at another T_world_base [m]; objects, goal and starts do not move.

    For a task with a chosen base, after the robot was installed there and its pose calibrated.
    """
    options = options or MovedBaseOptions()
    ctx.check(
        bundle.kind == "twin",
        f"the base is moved in a twin, but this task is in a {bundle.kind} world",
        hint="give the bundle of `simulate.task`, and make the other world of the result",
    )
    ctx.check(
        (base.parent, base.child) == ("world", "base"),
        f"the base is T_{base.parent}_{base.child}, but T_world_base is needed",
        hint="take it from `align.base`",
    )
    off = transforms.invert(bundle.base_pose.matrix) @ base.matrix
    distance, angle = float(np.linalg.norm(off[:3, 3])), float(np.degrees(transforms.angle(off[:3, :3])))
    if distance > options.most_m or angle > options.most_deg:
        ctx.warn(
            f"the base is {1000 * distance:.0f} mm and {angle:.1f} deg from where the task was planned: "
            "look at the calibration, or make the task again with `base` of `simulate.task`"
        )
    ctx.metric("base moved", 1000 * distance, "mm")
    ctx.metric("base turned", angle, "deg")
    ctx.say(f"base moved by {1000 * distance:.1f} mm and {angle:.2f} deg")
    model = compose.with_base(bundle.model, base.matrix)
    return bundle.model_copy(update={"model": model, "base_pose": base})
