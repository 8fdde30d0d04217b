"""reference.place_robot: put up a robot in a reference world at the pose chosen in its twin."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt

from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.world import RobotStand, World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from dextera_build.rule import Context, Options, rule

from .drawn.place_robot_in_view import pedestal


class PlaceRobotOptions(Options):
    """Options of reference.place_robot: errors of the installation."""

    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint -> position of the waiting robot [deg]; omitted joints are at home."""
    error_m: NonNegativeFloat = 0.01
    """Standard deviation of the base from the chosen position, per axis [m]."""
    error_deg: NonNegativeFloat = 1.0
    """Standard deviation of its rotation about z from the chosen one [deg]."""
    seed: NonNegativeInt = 0
    """Seed of these errors."""


@rule(version=1, packages=("numpy", "pillow", "manifold3d"))
def place_robot(
    ctx: Context, world: World, support: Support, base: Pose, *, options: PlaceRobotOptions | None = None
) -> World:
    """Return the world with a robot near T_world_base [m] of its twin, upright, on a pedestal if next to the table.

    The photograph's camera relates twin and world: `support` has T_world_camera. The installed pose differs from the
    chosen one by random errors, so that it must be calibrated.
    """
    options = options or PlaceRobotOptions()
    ctx.check(
        world.stand is None,
        "this world has a robot already",
        hint="leave option `robot` of `reference.world` out, or take the world without this rule",
    )
    ctx.check(
        (base.parent, base.child) == ("world", "base"),
        f"the place is T_{base.parent}_{base.child}, but T_world_base is needed",
        hint="take it from `align.base`",
    )
    draw = np.random.default_rng([options.seed, 5])
    chosen = (world.camera_pose @ support.camera_pose.inverse() @ base).matrix
    shift = options.error_m * draw.standard_normal(3)
    turn = float(np.radians(options.error_deg) * draw.standard_normal())
    place, yaw = chosen[:3, 3] + shift, float(np.arctan2(chosen[1, 0], chosen[0, 0])) + turn
    joints = {name: float(np.radians(value)) for name, value in options.joints_deg.items()}
    stand = RobotStand(position=tuple(place.tolist()), yaw=yaw, joints=joints)
    off = transforms.invert(chosen) @ stand.pose().matrix
    distance, angle = 1000 * float(np.linalg.norm(off[:3, 3])), float(np.degrees(transforms.angle(off[:3, :3])))
    ctx.metric("distance from the chosen place", distance, "mm")
    ctx.metric("rotation from the chosen place", angle, "deg")
    ctx.say(f"the robot is {distance:.1f} mm and {angle:.2f} deg from the chosen place; simulated")
    return world.model_copy(update={"stand": stand, "fixtures": world.fixtures | pedestal(world, stand)})
