"""Tasks on a plain table for the two arms of recipes `robot/openarm_revo1` and `robot/openarm_revo2`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, TaskObject, TaskSpec
from dextera_build.geometry import kinematics, metrics
from dextera_build.sim.model import compose
from dextera_build.sim.primitives.handover.primitive import HandoverGoal
from tests import factories, twins

BASE = factories.pose(-0.35, 0.0, -0.30)
"""T_world_base: the foot stands below the table, the arms reach over its edge."""


def bundle(
    robot: RobotModel,
    goal: Goal,
    assets: Mapping[str, Asset],
    thing: str,
    *,
    base: np.ndarray = BASE,
    limbs: tuple[str, ...] = (),
    timeout_s: float = 8.0,
) -> TaskBundle:
    """A task with the robot at `base` (4, 4), about object `thing` of `assets`, by label."""
    scene = twins.scene(assets, factories.background(half=0.5))
    reset = Reset(position_m=0.02, yaw_rad=0.2, clutter_m=0.0, robot_rad=0.0)
    return TaskBundle(
        model=compose.with_robot(scene, robot, base),
        robot=robot,
        base_pose=factories.placed(base, "base"),
        task=TaskSpec(name="Task", object=thing, goal=goal, limbs=limbs, reset=reset, timeout_s=timeout_s),
        objects={name: described(asset) for name, asset in sorted(assets.items())},
    )


def handover(robot: RobotModel) -> TaskBundle:
    """A bar of 40 x 40 x 200 mm, 150 g, that stands on the table is handed from the right hand to the left one."""
    bar = factories.box_asset(factories.pose(0.0, -0.08, 0.0), (0.04, 0.04, 0.20), 0.15, friction=0.6)
    return bundle(robot, HandoverGoal(giver="right", receiver="left"), {"bar": bar}, "bar", timeout_s=16.0)


def described(asset: Asset) -> TaskObject:
    """What a task needs to know of an asset without joints."""
    return TaskObject(
        joints=(),
        pose=asset.pose,
        positions=(),
        mass_scale=(0.8, 1.2),
        friction=asset.physics.friction,
        friction_sigma=0.05,
        points=metrics.sample_surface(*kinematics.posed_surface(asset.body), 256, seed=0).astype(np.float32),
    )
