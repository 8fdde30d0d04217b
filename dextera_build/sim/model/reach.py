"""Upper bound of a limb's reach from lengths alone, for any joint positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.model.links import ancestors
from dextera_build.sim.model.robot import load


@dataclass(frozen=True)
class Ball:
    """A ball that contains a limb at any joint positions."""

    joint: str
    """First joint of the limb, from the base."""
    centre_m: np.ndarray
    """Its position in the base frame (3,), at home [m]."""
    radius_m: float
    """Sum of the lengths from joint to joint, of the strokes of prismatic joints and of the parts beyond the last
    [m]."""


def of_limb(robot: RobotModel, limb: str) -> Ball | None:
    """The reach of a limb; None for one without joints.

    Args:
        robot: The embodiment.
        limb: Name of a limb.
    """
    joints = (*robot.limbs[limb].arm, *robot.limbs[limb].hand)
    if not joints:
        return None
    model = load(robot.model).compile()
    data = mujoco.MjData(model)
    for name, position in robot.followed(robot.home).items():
        data.joint(name).qpos[0] = position
    # Followers of a robot's model have no limits of their own.
    for follower in robot.followers:
        joint, leader = int(model.joint(follower.name).id), model.joint(follower.leader).range
        if not model.jnt_limited[joint]:
            model.jnt_range[joint] = np.sort(follower.ratio * leader + follower.offset)
            model.jnt_limited[joint] = True
    mujoco.mj_kinematics(model, data)
    body = int(model.joint(joints[0]).bodyid[0])
    way = ancestors(model, body)
    first = int(model.body_jntadr[next(each for each in reversed(way) if model.body_jntnum[each])])
    base = data.body("base")
    centre = base.xmat.reshape(3, 3).T @ (data.xanchor[first] - base.xpos)
    return Ball(model.joint(first).name, centre, _beyond(model, data, int(model.jnt_bodyid[first])))


def _beyond(model: Any, data: Any, body: int, pivot: np.ndarray | None = None) -> float:
    """Largest distance of any geometry on a body, or beyond it, from the preceding joint [m].

    Lengths between neighbouring joints do not depend on their positions, so every configuration gives the same.
    """
    way = 0.0
    for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        anchor = data.xanchor[joint]
        way += 0.0 if pivot is None else float(np.linalg.norm(anchor - pivot))
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            way += float(np.ptp(model.jnt_range[joint])) if model.jnt_limited[joint] else np.inf
        pivot = anchor
    place = data.xpos[body] if pivot is None else pivot
    geoms, sites = (np.flatnonzero(owner == body) for owner in (model.geom_bodyid, model.site_bodyid))
    ends = [
        *(np.linalg.norm(data.geom_xpos[geoms] - place, axis=1) + model.geom_rbound[geoms]),
        *np.linalg.norm(data.site_xpos[sites] - place, axis=1),
        *(_beyond(model, data, int(child), place) for child in np.flatnonzero(model.body_parentid == body) if child),
    ]
    return way + float(max(ends, default=0.0))
