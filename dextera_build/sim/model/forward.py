"""Poses of the parts of a robot at given joint positions, without a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import lie, transforms
from dextera_build.sim.model import robot as robots


class Kinematics:
    """Forward kinematics of a robot.

    Args:
        robot: Its model; joints that are not named are at home.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot
        self.model = robots.load(robot.model).compile()
        self.data = mujoco.MjData(self.model)

    def pose(self, joints: Mapping[str, float]) -> None:
        """Put the robot at joint positions [rad or m], followers included."""
        for name, position in self.robot.followed({**self.robot.home, **joints}).items():
            self.data.joint(name).qpos[0] = position
        mujoco.mj_forward(self.model, self.data)

    def frame(self, name: str) -> np.ndarray:
        """Current T_base_frame (4, 4) of a role of the robot's frames, of a site, or of a link.

        Raises:
            RuleError: There is no frame of this name.
        """
        base = self._of(self.data.body("base"))
        site = self.robot.frames.get(name, name)
        if site in [self.model.site(number).name for number in range(self.model.nsite)]:
            return np.asarray(transforms.invert(base) @ self._of(self.data.site(site)))
        if name in self.robot.links:
            return np.asarray(transforms.invert(base) @ self._of(self.data.body(name)))
        raise RuleError(
            f"the robot has no frame or link `{name}`",
            facts={"frames": listing(self.robot.frames), "links": listing(self.robot.links)},
            hint="name the part whose poses were recorded, or on which the board is, in `effector_frame`",
        )

    def frames(self, names: Sequence[str], positions: np.ndarray, frame: str) -> np.ndarray:
        """T_base_frame (K, 4, 4) [m] at joint positions (K, J) of joints `names`."""
        found = []
        for row in positions:
            self.pose(dict(zip(names, row.tolist(), strict=True)))
            found.append(self.frame(frame))
        return np.array(found).reshape(-1, 4, 4)

    @staticmethod
    def _of(thing: Any) -> np.ndarray:
        return transforms.rigid(thing.xmat.reshape(3, 3).copy(), thing.xpos.copy())


def drifts(robot: RobotModel, names: Sequence[str], positions: np.ndarray, frame: str) -> np.ndarray:
    """(K, 6, J) body twist of a frame per motion of each arm joint: translation [m] and rotation vector."""
    step = 1e-5
    plain = frames(robot, names, positions, frame)
    arm = [joint.name for joint in robot.joints if joint.group == "arm" and joint.name in names]
    found = np.zeros((len(plain), 6, len(arm)))
    for number, name in enumerate(arm):
        changed = positions + step * np.array([each == name for each in names])
        for row, (one, other) in enumerate(zip(plain, frames(robot, names, changed, frame), strict=True)):
            gap = transforms.invert(one) @ other
            found[row, :3, number] = gap[:3, 3] / step
            found[row, 3:, number] = lie.rotation_vector(gap[:3, :3]) / step
    return found


def frames(robot: RobotModel, names: Sequence[str], positions: np.ndarray, frame: str) -> np.ndarray:
    """T_base_frame (K, 4, 4) [m] at joint positions (K, J) of joints `names`."""
    return Kinematics(robot).frames(names, positions, frame)
