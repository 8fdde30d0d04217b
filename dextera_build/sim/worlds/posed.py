"""A reference world whose robot, slightly different from its model, holds a calibration board in several poses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import Part, World
from dextera_build.geometry import cameras, quaternions, transforms
from dextera_build.sim.model import robot as robots
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.render.shot import Shot, average
from dextera_build.sim.worlds import world as worlds

BOARD = "calibration_board"
LOWEST_M = 0.03
"""Minimum height of a moving link's origin and of the board above the table [m]."""
MARGIN_PX = 12
"""Minimum distance of the board from the picture's border [px]."""
LEAST_VISIBLE = 0.85
"""Minimum unoccluded fraction of the board."""


@dataclass(frozen=True)
class Plate:
    """The board on the robot."""

    part: Part  # its textured surface, in the board's frame
    corners: np.ndarray  # (4, 3) of its printed area, in the board's frame [m]
    frame: str  # role of the robot's frame that it is mounted on
    pose: np.ndarray  # (4, 4) T_frame_board


def biased(robot: RobotModel, shape: float, length: float) -> RobotModel:
    """The robot with an arm that differs from its model: surfaces and lengths of links larger by fractions."""
    spec = robots.load(robot.model)
    arm = {name for name, group in robot.links.items() if group == "arm"}
    for body in spec.bodies:
        if body.name in arm:
            for geom in body.geoms:
                _scale(spec, geom, 1.0 + shape)
        if body.name in arm and body.parent.name in arm:
            body.pos = np.asarray(body.pos) * (1.0 + length)
    spec.compile()
    files = {name: data for name, data in robot.model.files.items() if name != "robot.xml"}
    model = Folder(files={"robot.xml": spec.to_xml().encode(), **files})
    return robot.model_copy(update={"model": model})


def _scale(spec: Any, geom: Any, factor: float) -> None:
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = spec.mesh(geom.meshname)
        mesh.scale = np.asarray(mesh.scale) * factor
    geom.pos = np.asarray(geom.pos) * factor
    geom.size = np.asarray(geom.size) * factor
    if np.isfinite(np.asarray(geom.fromto)).all():
        geom.fromto = np.asarray(geom.fromto) * factor


class PosedWorld:
    """A world with the robot and a board on it.

    Args:
        world: The world; its robot keeps its pose.
        robot: The robot with its true properties.
        plate: The board on it.
    """

    def __init__(self, world: World, robot: RobotModel, plate: Plate) -> None:
        self.world, self.robot, self.plate = world, robot, plate
        site = robot.frames.get(plate.frame, plate.frame)
        stage = worlds.build(world, robot, lambda spec: _hold(spec, site, plate))
        self.model, self.data = stage.model, stage.data
        name = worlds.ROBOT + BOARD
        self.board = self.model.geom(name).id
        moving = [link for link in robot.links if link != "base"]
        self.moving = np.array([self.model.body(worlds.ROBOT + link).id for link in moving])
        self.hand = [self.model.body(worlds.ROBOT + link).id for link in robot.links if robot.links[link] == "hand"]
        self.contacts = int(self.data.ncon)

    def put(self, joints: Mapping[str, float]) -> None:
        """Set the robot to joint positions [rad]."""
        for name, position in self.robot.followed({**self.robot.home, **joints}).items():
            self.data.joint(worlds.ROBOT + name).qpos[0] = position
        mujoco.mj_forward(self.model, self.data)

    def board_pose(self) -> np.ndarray:
        """T_camera_board (4, 4)."""
        site = self.data.site(worlds.ROBOT + self.robot.frames.get(self.plate.frame, self.plate.frame))
        frame = transforms.rigid(site.xmat.reshape(3, 3), site.xpos)
        return np.asarray(transforms.invert(self.world.camera_pose.matrix) @ frame @ self.plate.pose)

    def fits(self, widest_deg: float) -> bool:
        """Whether the whole board faces the camera within an angle, without contacts and above the table."""
        pose = self.board_pose()
        corners = transforms.apply(pose, self.plate.corners)
        camera = self.world.camera
        if (corners[:, 2] < 0.15).any():
            return False
        pixels = cameras.project(corners, camera.matrix())
        inside = (pixels >= MARGIN_PX) & (pixels <= np.array([camera.width, camera.height]) - 1 - MARGIN_PX)
        middle = corners.mean(axis=0)
        facing = float(pose[:3, 2] @ middle) / float(np.linalg.norm(middle))  # z points away from the viewer
        heights = transforms.apply(self.world.camera_pose.matrix, corners)[:, 2]
        low = min(float(self.data.xpos[self.moving, 2].min()), float(heights.min())) < LOWEST_M
        return (
            bool(inside.all())
            and facing > np.cos(np.radians(widest_deg))
            and not low
            and self.data.ncon <= self.contacts
        )

    def shots(self, chosen: Sequence[Mapping[str, float]], supersample: int) -> Iterator[Shot]:
        """Pictures of the robot at each of `chosen`; labels are 1 for the arm, 2 for the hand, 3 for the board."""
        camera, pose = self.world.camera, self.world.camera_pose.matrix
        with Eye(self.model, camera, pose) as plain, Eye(self.model, camera.scaled(supersample), pose) as fine:
            for joints in chosen:
                self.put(joints)
                geoms = plain.segmentation(self.data)
                depth = plain.depth(self.data).astype(np.float64)
                yield Shot(average(fine.rgb(self.data), supersample), depth, self._labels(geoms))

    def visible(self, chosen: Sequence[Mapping[str, float]]) -> list[tuple[float, int]]:
        """For each posture the visible fraction of the board, and visible pixels of the hand, at half resolution."""
        camera, found = self.world.camera.scaled(0.5), []
        with Eye(self.model, camera, self.world.camera_pose.matrix, samples=1) as eye:
            for joints in chosen:
                self.put(joints)
                labels = self._labels(eye.segmentation(self.data))
                corners = cameras.project(transforms.apply(self.board_pose(), self.plate.corners), camera.matrix())
                x, y = corners.T
                area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
                found.append((float((labels == 3).sum()) / max(area, 1.0), 4 * int((labels == 2).sum())))
        return found

    def _labels(self, geoms: np.ndarray) -> np.ndarray:
        owner = np.zeros(self.model.ngeom + 1, np.int32)
        bodies = np.asarray(self.model.geom_bodyid)
        robot = np.isin(bodies, [*self.moving, self.model.body(worlds.ROBOT + "base").id])
        owner[:-1] = np.where(robot, np.where(np.isin(bodies, self.hand), 2, 1), 0)
        owner[self.board] = 3
        return np.asarray(owner[geoms])


def _hold(spec: Any, site_name: str, plate: Plate) -> None:
    """Fix the board to one of the robot's frames."""
    site = next(each for each in spec.sites if each.name == site_name)
    turn = quaternions.to_matrix(np.asarray(site.quat, np.float64))
    pose = transforms.rigid(turn, np.asarray(site.pos, np.float64)) @ plate.pose
    body = site.parent.add_body(name=BOARD, pos=pose[:3, 3], quat=quaternions.from_matrix(pose[:3, :3]))
    body.explicitinertial, body.mass, body.inertia = True, 0.1, [1e-3, 1e-3, 1e-3]
    worlds.add_part(spec, body, BOARD, plate.part)
