"""A robot's hand as URDF, so that a peer has the same kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dextera_build.geometry import transforms
from dextera_build.sim.retarget.hand_model import HandModel


def written(hand: HandModel, frames: Mapping[str, np.ndarray], tips: Mapping[str, int]) -> str:
    """URDF of a hand without followers: link `base` in the palm's frame, joints of the same names and limits.

    Args:
        hand: The hand.
        frames: Further links, fixed to the palm: (4, 4) T_palm_link.
        tips: Further links at fingertips: place among the fingertips of the hand.
    """
    model, data = hand.model, mujoco.MjData(hand.model)
    mujoco.mj_kinematics(model, data)
    robot = ElementTree.Element("robot", name="hand")
    _link(robot, "base")
    for body in range(1, model.nbody):
        if not any(model.body_dofnum[each] for each in _above(model, body)):
            continue
        parent = int(model.body_parentid[body])
        moving = any(model.body_dofnum[each] for each in _above(model, parent))
        pose = transforms.invert(_world(data, parent) if moving else hand.palm) @ _world(data, body)
        _link(robot, name := model.body(body).name)
        joint = model.body(body).jntadr[0] if model.body_dofnum[body] else -1
        _joint(robot, model, name, model.body(parent).name if moving else "base", (pose, joint))
    for name, pose in frames.items():
        _link(robot, name)
        _joint(robot, model, name, "base", (pose, -1))
    for name, finger in tips.items():
        body = int(hand.bodies[finger])
        site = transforms.rigid(np.eye(3), model.site_pos[hand.site(finger)])
        _link(robot, name)
        _joint(robot, model, name, model.body(body).name, (site, -1))
    return ElementTree.tostring(robot, encoding="unicode")


def _above(model: mujoco.MjModel, body: int) -> list[int]:
    found = []
    while body:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _world(data: mujoco.MjData, body: int) -> np.ndarray:
    return transforms.rigid(data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy())


def _link(robot: ElementTree.Element, name: str) -> None:
    inertial = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=name), "inertial")
    ElementTree.SubElement(inertial, "mass", value="0.01")
    ElementTree.SubElement(inertial, "inertia", ixx="1e-6", iyy="1e-6", izz="1e-6", ixy="0", ixz="0", iyz="0")


def _joint(
    robot: ElementTree.Element, model: mujoco.MjModel, link: str, parent: str, place: tuple[np.ndarray, int]
) -> None:
    pose, joint = place
    fixed = joint < 0
    name = f"{link}_fixed" if fixed else model.joint(joint).name
    made = ElementTree.SubElement(robot, "joint", name=name, type="fixed" if fixed else "revolute")
    ElementTree.SubElement(made, "parent", link=parent)
    ElementTree.SubElement(made, "child", link=link)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
    ElementTree.SubElement(made, "origin", xyz=_text(pose[:3, 3]), rpy=_text(angles))
    if not fixed:
        assert not model.jnt_pos[joint].any(), "a hinge beside the origin of its link"
        ElementTree.SubElement(made, "axis", xyz=_text(model.jnt_axis[joint]))
        lower, upper = model.jnt_range[joint]
        ElementTree.SubElement(made, "limit", lower=f"{lower:.9g}", upper=f"{upper:.9g}", effort="1", velocity="10")


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in values)
