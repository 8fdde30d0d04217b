"""benchmark.base_error: errors of the robot's base pose in a twin, as far as the twin's world defines them."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.table import Table
from dextera_build.rule import Context, rule

from . import errors


@rule(version=1, packages=("numpy", "scipy"))
def base_error(ctx: Context, world: World, base: Pose) -> Table:
    """Return the errors of height above the support [mm] and of lean [deg] of T_world_base.

    The twin's world has its own origin and heading, so that only its z axis and its plane z = 0 can be compared.
    """
    if world.stand is None:
        ctx.fail("this world has no robot", hint="give the world of `reference.place_robot_in_view`")
    high = 1000 * float(base.matrix[2, 3] - world.stand.position[2])
    lean = float(np.degrees(np.arccos(np.clip(base.matrix[2, 2], -1.0, 1.0))))
    spread = None if base.covariance is None else base.covariance[2:3, 2:3]
    region = errors.inside(np.array([high / 1000]), spread)
    ctx.say(f"base {high:+.1f} mm high, leaning {lean:.2f} deg")
    return errors.table(
        "The robot's base in a twin against the truth",
        [("", "base height", "mm", abs(high), region), ("", "base lean", "deg", lean, None)],
        ("base: height above the support and angle between its axis and the support's normal, in the twin's world",),
    )
