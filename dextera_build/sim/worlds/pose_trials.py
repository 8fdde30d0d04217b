"""A reference world in which a robot is tried at several poses, to measure occlusions."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import RobotStand, World
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.worlds import world as worlds

SHARE = 0.25
"""Fraction of the camera's resolution."""
FAR_M = 100.0
"""Position at which the robot is outside every picture [m]."""


class TriedWorld:
    """A world and a robot, compiled once.

    Args:
        world: The world, with its camera.
        robot: The robot.
    """

    def __init__(self, world: World, robot: RobotModel) -> None:
        self._robot, self._camera, self._pose = robot, world.camera.scaled(SHARE), world.camera_pose.matrix
        away = RobotStand(position=(0.0, 0.0, FAR_M), yaw=0.0, joints={})
        stage = worlds.build(world.model_copy(update={"stand": away}), robot)
        self._model, self._data = stage.model, stage.data
        self._owner = stage.label_of_geom
        bodies = {name: self._model.body(worlds.ROBOT + name).id for name in robot.links}
        geoms = np.append(np.asarray(self._model.geom_bodyid), -1)
        self._arm = np.isin(geoms, list(bodies.values()))
        self._hand = np.isin(geoms, [bodies[name] for name, group in robot.links.items() if group == "hand"])
        self._base = bodies["base"]
        self._alone = self._counts()[0]

    def sight(self, stand: RobotStand) -> tuple[np.ndarray, float, float]:
        """Fraction of each object's pixels (N,) that the robot hides, and fractions of the picture with robot and hand.

        Objects outside the picture count as not hidden.
        """
        self._put(stand)
        seen, robot, hand = self._counts()
        hidden = 1.0 - seen / np.maximum(self._alone, 1)
        return np.where(self._alone > 0, hidden, 0.0), robot, hand

    def _put(self, stand: RobotStand) -> None:
        half = stand.yaw / 2
        self._model.body_pos[self._base] = stand.position
        self._model.body_quat[self._base] = [np.cos(half), 0.0, 0.0, np.sin(half)]
        for name, position in self._robot.followed({**self._robot.home, **stand.joints}).items():
            self._data.joint(worlds.ROBOT + name).qpos[0] = position
        mujoco.mj_forward(self._model, self._data)

    def _counts(self) -> tuple[np.ndarray, float, float]:
        """Pixels of each object (N,), fractions of the picture with the robot and its hand."""
        with Eye(self._model, self._camera, self._pose, samples=1) as eye:
            geoms = eye.segmentation(self._data)
        count = int(self._owner.max())
        things = np.bincount(self._owner[geoms].ravel(), minlength=count + 1)[1:]
        return things, float(self._arm[geoms].mean()), float(self._hand[geoms].mean())
