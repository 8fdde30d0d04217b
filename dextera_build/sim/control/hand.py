"""Kinematics of a hand on its own: fingertip positions in the palm's frame."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.sim.model.robot import load

THUMB = "tip_thumb"
"""Role of the fingertip that opposes the others."""


class HandKinematics:
    """Fingertips in the palm's frame.

    Args:
        robot: The embodiment; it has a frame `palm` and frames `tip_...`.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.joints: tuple[str, ...] = robot.names("hand")
        """Joints of the hand, in order."""
        self.fingers: tuple[str, ...] = tuple(role for role in robot.tips if role != THUMB)
        """Roles of the fingertips that oppose the thumb."""
        self.home = np.array([robot.home[name] for name in self.joints])
        """(H,) home [rad]."""
        self._robot = robot
        self._model = load(robot.model).compile()
        self._data = mujoco.MjData(self._model)

    def posture(self, joints: Mapping[str, float]) -> np.ndarray:
        """(H,) joint positions [rad] of a posture by joint name; omitted joints are at home."""
        return np.array([joints.get(name, home) for name, home in zip(self.joints, self.home, strict=True)])

    def tip(self, role: str, posture: np.ndarray) -> np.ndarray:
        """Position (3,) [m] of a fingertip in the palm's frame at a posture (H,) [rad]."""
        for name, position in zip(self.joints, posture, strict=True):
            self._data.joint(name).qpos[0] = position
        mujoco.mj_kinematics(self._model, self._data)
        palm = self._data.site(self._robot.frames["palm"])
        away = self._data.site(self._robot.frames[role]).xpos - palm.xpos
        return np.asarray(palm.xmat.reshape(3, 3).T @ away)

    def reach(self, posture: np.ndarray) -> np.ndarray:
        """Mean position (3,) [m] of the fingertips that oppose the thumb, in the palm's frame."""
        return np.asarray(np.mean([self.tip(role, posture) for role in self.fingers], axis=0))
