"""Inverse kinematics of a robot's hand frame; objects are ignored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mink
import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model.robot import load

SOLVER = "daqp"
POSITION_COST = 10.0
"""Weight of a metre in the least squares; a radian has weight 1, so a millimetre weighs as much as 0.6 degrees."""
POSTURE_COST = 1e-2
"""Weight of a radian away from the seed: resolves the arm's redundancy without displacing the hand."""
ITERATIONS = 120
"""Maximum iterations per descent."""
SEED_SPREAD_RAD = 0.6
"""Standard deviation of restarts around the seed [rad]."""


@dataclass(frozen=True)
class Solution:
    """Arm joints that bring the frame to a pose, with the residual error."""

    joints: np.ndarray
    """(A,) arm joints [rad]."""
    position_error_m: float
    """Remaining position error [m]."""
    rotation_error_rad: float
    """Remaining rotation error [rad]."""
    margin_rad: float
    """Smallest distance of a joint to its limit [rad]."""

    def reached(self, position_m: float = 0.002, rotation_rad: float = 0.01) -> bool:
        """Whether the residual is within these bounds [m, rad]."""
        return self.position_error_m <= position_m and self.rotation_error_rad <= rotation_rad


class ArmKinematics:
    """Forward and inverse kinematics of one frame of a robot's arm, with the hand fixed.

    Args:
        robot: The embodiment; joints of group `hand` are fixed at home.
        frame: Role of the target frame: `palm`, `flange`, a fingertip.
    """

    def __init__(self, robot: RobotModel, frame: str = "palm") -> None:
        self.joints: tuple[str, ...] = robot.names("arm")
        """Arm joints, in order."""
        self._model = _arm_alone(robot)
        self._frame = robot.frames[frame]
        arm = [joint for joint in robot.joints if joint.group == "arm"]
        self._address = np.array([self._model.joint(name).qposadr[0] for name in self.joints])
        self.lower = np.array([joint.lower for joint in arm])
        """(A,) lower limits [rad]."""
        self.upper = np.array([joint.upper for joint in arm])
        """(A,) upper limits [rad]."""
        self.home = np.array([joint.home for joint in arm])
        """(A,) home [rad]."""
        self._state = mink.Configuration(self._model)
        self._hand = mink.FrameTask(self._frame, "site", POSITION_COST, 1.0, lm_damping=1e-3)
        self._posture = mink.PostureTask(self._model, POSTURE_COST)
        self._range = mink.ConfigurationLimit(self._model)
        self._speed = mink.VelocityLimit(self._model, {joint.name: joint.velocity for joint in arm})

    def pose(self, joints: np.ndarray) -> np.ndarray:
        """T_base_frame (4, 4) at arm joints (A,) [rad]."""
        self._state.update(self._spread(joints))
        site = self._state.data.site(self._frame)
        return transforms.rigid(site.xmat.reshape(3, 3).copy(), site.xpos.copy())

    def solve(
        self,
        target: np.ndarray,
        seed: np.ndarray | None = None,
        *,
        restarts: int = 6,
        posture: np.ndarray | None = None,
    ) -> Solution:
        """Solve for the nearest joints that bring the frame to `target`, from several starts.

        Args:
            target: (4, 4) T_base_frame.
            seed: (A,) initial joints [rad]; None: home. Restarts are drawn around it deterministically.
            restarts: Further starts if the first does not reach the target.
            posture: (A,) preferred joints for the redundancy [rad]; None: the seed.
        """
        start = self.home if seed is None else np.asarray(seed, np.float64)
        rest = start if posture is None else np.asarray(posture, np.float64)
        rng = np.random.default_rng(0)
        best: Solution | None = None
        for attempt in range(restarts + 1):
            guess = start + (rng.normal(0.0, SEED_SPREAD_RAD, len(start)) if attempt else 0.0)
            found = self._descend(target, np.clip(guess, self.lower, self.upper), rest)
            if best is None or _cost(found) < _cost(best):
                best = found
            if best.reached():
                break
        assert best is not None
        return best

    def track(
        self, target: np.ndarray, joints: np.ndarray, dt: float, *, posture: np.ndarray | None = None
    ) -> np.ndarray:
        """Joints (A,) [rad] after one control step of `dt` [s], as near to `target` (4, 4) as speed limits allow."""
        self._state.update(self._spread(joints))
        self._hand.set_target(_se3(target))
        self._posture.set_target(self._spread(self.home if posture is None else posture))
        steps = 3
        start = self._state.q.copy()
        for _ in range(steps):
            self._step(dt / steps, (self._range, self._speed))
        moved = np.asarray(self._state.q[self._address])
        return np.asarray(np.clip(moved, self.lower, self.upper) if np.isfinite(moved).all() else start[self._address])

    def _descend(self, target: np.ndarray, guess: np.ndarray, rest: np.ndarray) -> Solution:
        self._state.update(self._spread(guess))
        self._hand.set_target(_se3(target))
        self._posture.set_target(self._spread(rest))
        for _ in range(ITERATIONS):
            before = self._state.q.copy()
            self._step(1.0, (self._range,))
            if np.abs(self._state.q - before).max() < 1e-5:
                break
        joints = np.clip(self._state.q[self._address], self.lower, self.upper)
        left = transforms.invert(self.pose(joints)) @ target
        return Solution(
            joints=joints,
            position_error_m=float(np.linalg.norm(left[:3, 3])),
            rotation_error_rad=transforms.angle(left[:3, :3]),
            margin_rad=float(np.minimum(joints - self.lower, self.upper - joints).min()),
        )

    def _step(self, dt: float, limits: Sequence[Any]) -> None:
        velocity = mink.solve_ik(
            self._state, [self._hand, self._posture], dt, solver=SOLVER, damping=1e-6, limits=limits, safety_break=False
        )
        self._state.integrate_inplace(velocity, dt)

    def _spread(self, joints: np.ndarray) -> np.ndarray:
        positions = self._model.qpos0.copy()
        positions[self._address] = joints
        return np.asarray(positions)


def _arm_alone(robot: RobotModel) -> Any:
    spec = load(robot.model)
    home = robot.followed(robot.home)
    for element in [*spec.actuators, *spec.equalities]:
        spec.delete(element)
    hand = {*robot.names("hand"), *(follower.name for follower in robot.followers)}
    for joint in list(spec.joints):
        if joint.name in hand:
            body = joint.parent
            turn = np.concatenate([[np.cos(home[joint.name] / 2)], np.sin(home[joint.name] / 2) * np.array(joint.axis)])
            body.quat = quaternions.from_matrix(
                quaternions.to_matrix(np.array(body.quat)) @ quaternions.to_matrix(turn)
            )
            spec.delete(joint)
    return spec.compile()


def _se3(pose: np.ndarray) -> Any:
    return mink.SE3.from_matrix(np.asarray(pose, np.float64))


def _cost(solution: Solution) -> float:
    return POSITION_COST * solution.position_error_m + solution.rotation_error_rad
