"""Ray casting of a robot: depth, normals, links, and the motion of its points with its joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import cameras, raycast, transforms
from dextera_build.sim.model import tessellate
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.model.robot import CONTACT_GROUP

PARTS = ("arm", "hand")
"""Labels 1 and 2."""


@dataclass(frozen=True)
class RobotView:
    """Pixels of the robot in one picture."""

    depth: np.ndarray  # (H, W) float64 image-plane z [m]; 0 outside the robot
    labels: np.ndarray  # (H, W) int32: 1 arm, 2 hand, 0 outside the robot
    link: np.ndarray  # (H, W) int32, number of the link; -1 outside the robot
    points: np.ndarray  # (H, W, 3) in the camera frame [m]
    normals: np.ndarray  # (H, W, 3) in the camera frame, towards the camera


class RobotRenderer:
    """Ray-casts a robot's visual geometry.

    Args:
        robot: Its model.
        camera: Intrinsics.
    """

    def __init__(self, robot: RobotModel, camera: Camera) -> None:
        self.kinematics, self.camera = Kinematics(robot), camera
        model = self.kinematics.model
        names = [model.body(number).name for number in range(model.nbody)]
        self._part = np.array([1 + PARTS.index(robot.links[name]) if name in robot.links else 0 for name in names])
        self._drawn = [geom for geom in range(model.ngeom) if model.geom_group[geom] != CONTACT_GROUP]
        self._arm = [joint.name for joint in robot.joints if joint.group == "arm"]

    def view(self, joints: Mapping[str, float], camera_base: np.ndarray) -> RobotView:
        """The robot at joint positions [rad] with its base at T_camera_base (4, 4)."""
        self.kinematics.pose(joints)
        model, data = self.kinematics.model, self.kinematics.data
        made = tessellate.surfaces(model, data)
        surfaces = [raycast.Surface(made[geom].vertices, made[geom].faces) for geom in self._drawn]
        world_camera = self._root() @ transforms.invert(camera_base)
        camera = self.camera
        seen = raycast.render(surfaces, camera.matrix(), world_camera, camera.height, camera.width)
        body = np.append(np.asarray(model.geom_bodyid)[self._drawn], 0)[seen.index]
        there = seen.index >= 0
        normals = seen.normal @ world_camera[:3, :3]
        points = cameras.backproject(seen.depth, camera.matrix())
        away = (normals * points).sum(axis=-1) > 0
        return RobotView(
            depth=np.where(there, seen.depth, 0.0),
            labels=np.where(there, self._part[body], 0).astype(np.int32),
            link=np.where(there, body, -1).astype(np.int32),
            points=points,
            normals=np.where(away[..., None], -normals, normals),
        )

    def drift(self, points: np.ndarray, link: np.ndarray, camera_base: np.ndarray) -> np.ndarray:
        """(N, 3, J) motion of points (N, 3) in the camera, on links (N,), per motion of each arm joint [m/rad]."""
        model, data = self.kinematics.model, self.kinematics.data
        turn = (camera_base @ transforms.invert(self._root()))[:3, :3]
        places = transforms.apply(self._root() @ transforms.invert(camera_base), points)
        found = np.zeros((len(points), 3, len(self._arm)))
        for number, name in enumerate(self._arm):
            joint = model.joint(name)
            moved = self._below(int(joint.bodyid[0]))[link]
            axis, anchor = data.joint(name).xaxis, data.joint(name).xanchor
            found[moved, :, number] = np.cross(axis, places[moved] - anchor) @ turn.T
        return found

    def _below(self, root: int) -> np.ndarray:
        """A body and its descendants, as a mask (B,)."""
        parents = np.asarray(self.kinematics.model.body_parentid)
        found = np.zeros(len(parents), bool)
        for number in range(len(parents)):  # parents come before their children
            found[number] = number == root or (number > 0 and found[parents[number]])
        return found

    def _root(self) -> np.ndarray:
        base = self.kinematics.data.body("base")
        return transforms.rigid(base.xmat.reshape(3, 3), base.xpos)
