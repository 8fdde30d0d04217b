"""Kinematics of a hand: fingertip positions in the palm's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.model.robot import load

STILL_M = 0.005
"""Displacement below which a fingertip does not take part in a grip [m]."""


class HandKinematics:
    """Fingertips of one limb in its palm's frame.

    Args:
        robot: The embodiment.
        limb: Name of a limb with a palm and fingertips.
    """

    def __init__(self, robot: RobotModel, limb: str) -> None:
        own = robot.limbs[limb]
        self.joints: tuple[str, ...] = own.hand
        """Joints of the hand, in order."""
        self.thumb: str | None = own.thumb
        """Role of the fingertip that opposes the others."""
        self.fingers: tuple[str, ...] = own.fingers
        """Roles of the fingertips that oppose the thumb."""
        self.roles: tuple[str, ...] = own.tips
        """Roles of all fingertips."""
        self.home = np.array([robot.home[name] for name in self.joints])
        """(H,) home [rad]."""
        self._robot, self._palm = robot, own.palm
        self._model = load(robot.model).compile()
        self._data = mujoco.MjData(self._model)

    def posture(self, joints: Mapping[str, float]) -> np.ndarray:
        """(H,) joint positions [rad] of a posture by joint name; omitted joints are at home."""
        return np.array([joints.get(name, home) for name, home in zip(self.joints, self.home, strict=True)])

    def tip(self, role: str, posture: np.ndarray) -> np.ndarray:
        """Position (3,) [m] of a fingertip in the palm's frame at a posture (H,) [rad]."""
        for name, position in self._robot.followed(dict(zip(self.joints, posture.tolist(), strict=True))).items():
            self._data.joint(name).qpos[0] = position
        mujoco.mj_kinematics(self._model, self._data)
        palm = self._data.site(self._robot.frames[self._palm])
        away = self._data.site(self._robot.frames[role]).xpos - palm.xpos
        return np.asarray(palm.xmat.reshape(3, 3).T @ away)

    def reach(self, posture: np.ndarray, fingers: Sequence[str] = ()) -> np.ndarray:
        """Mean position (3,) [m] of `fingers` in the palm's frame; if empty, of all opposite the thumb."""
        return np.asarray(np.mean([self.tip(role, posture) for role in fingers or self.fingers], axis=0))

    def pressing(self, opened: np.ndarray, closed: np.ndarray) -> tuple[str, ...]:
        """Fingertips opposite the thumb that move between two postures (H,); if none moves, all."""
        moved = {role: self.tip(role, closed) - self.tip(role, opened) for role in self.fingers}
        return tuple(role for role, way in moved.items() if np.linalg.norm(way) > STILL_M) or self.fingers
