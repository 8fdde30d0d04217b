"""The robot's poses for the pictures, from its controller or its joints; implausible ones are refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import listing
from dextera_build.geometry import poses, transforms
from dextera_build.rule import Context

Kinematics = Callable[[RobotModel, Sequence[str], np.ndarray, str], np.ndarray]
"""See `sim.model.forward.frames`."""
FAR_M = 20.0
"""Larger than the reach of any arm [m]; exceeded if the unit is millimetres."""
BEYOND_RAD = 0.05
"""Tolerance of joint readings beyond the joint limits [rad]."""
CONTRADICTION_DEG = 3.0
"""Median difference between the effector's rotations from joints and from the controller that is a contradiction
[deg]."""


def effectors(ctx: Context, views: RobotViews, robot: RobotModel | None, frame: str, frames: Kinematics) -> np.ndarray:
    """T_base_effector (K, 4, 4) of every picture."""
    by_joints = None
    if views.joints is not None and robot is not None:
        check_joints(ctx, views.joints, robot)
        part = frame if views.effectors is None else frame_of(robot, frame)
        by_joints = frames(robot, views.joints.names, views.joints.positions, part)
    if views.effectors is None:
        if by_joints is None:
            ctx.fail(
                "only joint positions are known, and no robot whose kinematics turn them into poses",
                hint="give the input `robot`, or record the controller's T_base_ee with each picture",
            )
        return by_joints
    stated = np.stack([poses.to_matrix(row) for row in views.effectors])
    far = float(np.abs(stated[:, :3, 3]).max())
    if far > FAR_M:
        ctx.fail(
            f"the effector is {far:.0f} m from the base: its positions look like millimetres",
            hint="divide the positions by 1000",
        )
    if by_joints is not None:
        _compare(ctx, stated, by_joints)
    return stated


def check_joints(ctx: Context, joints: Joints, robot: RobotModel) -> None:
    """Raise for joints of another robot, and for degrees."""
    limits = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    known = set(limits) | {follower.name for follower in robot.followers}
    if unknown := sorted(set(joints.names) - known):
        ctx.fail(
            f"the robot has no joint `{unknown[0]}`",
            stated=listing(joints.names, most=30),
            robot=listing(limits, most=30),
            hint="rename the columns of the joint states, or give the robot that they come from",
        )
    arm = [joint.name for joint in robot.joints if joint.group == "arm"]
    if missing := [name for name in arm if name not in joints.names]:
        ctx.fail(
            f"no position of the arm's joint `{missing[0]}` is known",
            stated=listing(joints.names, most=30),
            hint="record the states of all joints of the arm",
        )
    checked = [(column, name) for column, name in enumerate(joints.names) if name in limits]
    beyond = {name: _beyond(joints.positions[:, column], *limits[name]) for column, name in checked}
    bad = {name: far for name, far in beyond.items() if far > BEYOND_RAD}
    if not bad:
        return
    worst = max(bad, key=lambda name: bad[name])
    low, high = limits[worst]
    reached = joints.positions[:, joints.names.index(worst)]
    degrees = all(_beyond(np.radians(joints.positions[:, c]), *limits[name]) <= BEYOND_RAD for c, name in checked)
    looks = degrees and float(np.abs(joints.positions).max()) > 2 * np.pi
    ctx.fail(
        f"joint `{worst}` is beyond its limits" + (": the positions look like degrees" if looks else ""),
        positions=f"{reached.min():.3g} to {reached.max():.3g}",
        limits=f"{low:.3g} to {high:.3g} rad",
        hint="convert the positions to radians" if looks else "look whether the columns have the right names",
    )


def _beyond(positions: np.ndarray, low: float, high: float) -> float:
    return float(max(low - positions.min(), positions.max() - high, 0.0))


def frame_of(robot: RobotModel, frame: str) -> str:
    """A frame fixed to the last link of the arm, if the stated frame exists only in the controller."""
    if frame in robot.frames or frame in robot.links:
        return frame
    return "flange" if "flange" in robot.frames else [name for name, group in robot.links.items() if group == "arm"][-1]


def _compare(ctx: Context, stated: np.ndarray, by_joints: np.ndarray) -> None:
    """Raise if rotations between poses differ from those of the joints; the frames of both may differ."""

    def angles(motions: np.ndarray) -> np.ndarray:
        first = motions[0, :3, :3].T
        return np.array([transforms.angle(first @ each[:3, :3]) for each in motions[1:]])

    if len(stated) < 2:
        return
    off = np.degrees(np.abs(angles(stated) - angles(by_joints)))
    ctx.check(
        float(np.median(off)) < CONTRADICTION_DEG,
        f"the effector's rotations contradict the joints: by {np.median(off):.0f} deg in the median",
        hint="look at the names and the order of the joints, and whether both were recorded at the same times",
    )
