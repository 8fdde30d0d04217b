"""The kinematic tree of a robot, from which a saved page poses the robot without a server.

`assets/page.js` does what `mujoco.mj_kinematics` does: a body's pose in its parent, then each joint about its anchor.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel


def tree(robot: RobotModel, model: Any, units: Mapping[str, float], names: Mapping[int, str]) -> dict[str, Any]:
    """Joints, bodies and scene nodes of a robot, as JSON data.

    Args:
        robot: The robot.
        model: Its compiled model.
        units: Actuated joint -> units of its slider per radian or metre.
        names: Body of the model -> the scene node that follows it.

    Returns:
        `joints`: limits and home [rad, of sliding joints m], and units. `bodies`, parents first: parent, pose (7,) in
        it as position [m] and quaternion w, x, y, z, and joints. `nodes`: body, and pose (7,) in it.
    """
    order = [joint.name for joint in robot.joints]
    led = {each.name: (order.index(each.leader), each.ratio, each.offset) for each in robot.followers}
    led |= {name: (number, 1.0, 0.0) for number, name in enumerate(order)}
    bodies = [
        {
            "parent": int(model.body_parentid[body]),
            "pose": _pose(model.body_pos[body], model.body_quat[body]),
            "joints": [_joint(model, joint, led) for joint in range(model.njnt) if model.jnt_bodyid[joint] == body],
        }
        for body in range(1, model.nbody)
    ]
    still = np.array([1.0, 0.0, 0.0, 0.0])
    nodes = [{"name": name, "body": body, "pose": _pose(np.zeros(3), still)} for body, name in names.items()]
    joints = [
        {"name": each.name, "unit": units[each.name], "low": each.lower, "high": each.upper, "home": each.home}
        for each in robot.joints
    ]
    return {"joints": joints, "bodies": bodies, "nodes": nodes}


def node(model: Any, name: str, site: str) -> dict[str, Any]:
    """A scene node that follows a site."""
    found = model.site(site)
    return {"name": name, "body": int(found.bodyid[0]), "pose": _pose(found.pos, found.quat)}


def _joint(model: Any, joint: int, led: Mapping[str, tuple[int, float, float]]) -> dict[str, Any]:
    """A joint turns or slides by `ratio` times slider `of`, plus `offset`; without a slider it stays at `offset`."""
    zero = float(model.qpos0[model.jnt_qposadr[joint]])
    of, ratio, offset = led.get(model.joint(joint).name, (-1, 0.0, zero))
    return {
        "turns": bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE),
        "axis": _rounded(model.jnt_axis[joint]),
        "at": _rounded(model.jnt_pos[joint]),
        "of": of,
        "ratio": ratio,
        "offset": offset - zero,
    }


def _pose(position: np.ndarray, quaternion: np.ndarray) -> list[float]:
    return [*_rounded(position), *_rounded(quaternion)]


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 7) for value in values]
