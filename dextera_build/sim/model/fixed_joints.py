"""Robots with some joints fixed, for kinematics of an arm or of a hand alone."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import lie, quaternions
from dextera_build.sim.model.robot import load


def alone(robot: RobotModel, kept: Collection[str]) -> Any:
    """The compiled model of a robot without actuators, with all joints but `kept` fixed at home."""
    spec = load(robot.model)
    home = robot.followed(robot.home)
    for element in [*spec.actuators, *(each for each in spec.equalities if each.name1 not in kept)]:
        spec.delete(element)
    for joint in list(spec.joints):
        if joint.name in home and joint.name not in kept:
            fix(spec, joint.name, home[joint.name])
    # MuJoCo does not take a link that is fixed to the world for a parent, and would let it touch its children.
    apart = {frozenset((pair.bodyname1, pair.bodyname2)) for pair in spec.excludes}
    links = {frozenset((body.name, child.name)) for body in spec.bodies[1:] for child in body.bodies}
    for one, other in sorted(sorted(pair) for pair in links - apart):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return spec.compile()


def fix(spec: Any, name: str, position: float) -> None:
    """Replace a joint by the pose that it gives its body at `position` [rad or m]."""
    joint = spec.joint(name)
    body, axis = joint.parent, np.array(joint.axis) / np.linalg.norm(joint.axis)
    moved = position - float(joint.ref)
    if moved:
        turn = quaternions.to_matrix(np.array(body.quat))
        if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
            body.pos = np.array(body.pos) + turn @ (axis * moved)
        else:
            anchor, rotation = np.array(joint.pos), lie.rotation(axis * moved)
            body.pos = np.array(body.pos) + turn @ (anchor - rotation @ anchor)
            body.quat = quaternions.from_matrix(turn @ rotation)
    spec.delete(joint)
