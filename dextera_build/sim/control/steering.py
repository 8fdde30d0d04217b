"""Inputs and actions of a reinforcement-learned policy: small steps of the palm or of joints.

A decision lasts for several control periods, over which the joint targets move linearly to its goal. It depends only on
the last targets and the joint positions, so that no state is kept between decisions.
"""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.artifacts.policy import Channel, PolicyContract
from dextera_build.artifacts.robot import RobotModel
from dextera_build.geometry import quaternions
from dextera_build.policy.features import Fields
from dextera_build.sim.model import robot as robots

ITERATIONS = 3
"""Newton steps towards a nearby pose of the palm."""
DAMPING = 0.05
"""Damping of the least squares, in which rotation is weighted by `RADIAN_M`."""
RADIAN_M = 0.3
"""Weight of a radian of palm rotation, in metres."""
TURN_RAD = 0.3
"""Maximum rotation of the palm towards its target orientation per Newton step [rad]."""
PLACE_M = 0.2
"""Scale of positions in the network's input [m]."""
POSTURE = 0.02
"""Fraction of the way home that the arm's redundancy moves per Newton step."""


class Steering:
    """Maps decisions (M,), each -1 to 1, to joint targets.

    With `control` "palm" the first three decisions move the palm of `limb` along the axes of the robot's base by up
    to `step_m`, while it turns to the quaternion `palm_w` ... `palm_z` in the base, or keeps its home orientation
    without one. All other decisions, or all with "joints", move the target of one joint by up to `step_rad`.
    Uncontrolled joints go to the contract's mean. With "palm" the network's input also contains the positions of
    the palm and the mean fingertip, so kinematics need not be learned.

    Args:
        robot: The embodiment.
        contract: The policy's contract, with these settings.
    """

    def __init__(self, robot: RobotModel, contract: PolicyContract) -> None:
        settings = contract.settings
        names = contract.action.names
        self.every = int(settings["every"])
        self._step_m, self._step_rad = float(settings["step_m"]), float(settings["step_rad"])
        self._lead = float(settings["lead_rad"])
        self._rest = np.array(contract.action.mean)
        single = str(settings["joints"]).split()
        self._single = np.array([names.index(name) for name in single], int)
        turn = np.array([float(settings[f"palm_{part}"]) for part in "wxyz" if f"palm_{part}" in settings])
        self.limb = str(settings.get("limb", robot.limb_names[0]))
        """The limb whose palm moves."""
        palm = settings["control"] == "palm"
        self._palm = _Palm(robot, self.limb, names, self._rest, turn) if palm else None
        self.size = len(self._single) + (3 if self._palm else 0)
        self._channels = contract.inputs

    def numbers(self, inputs: Fields) -> np.ndarray:
        """The network's input for one sample of every channel, (1, N) float32."""
        plain = _flat(inputs, self._channels)
        if self._palm is None:
            return plain
        return np.concatenate([plain, self._palm.places(_raw(inputs, self._channels, "joints"))[None]], axis=1)

    def steered(self, decision: np.ndarray, inputs: Fields) -> np.ndarray:
        """`targets` with the joints and last targets of `inputs`."""
        sent, joints = (_raw(inputs, self._channels, name) for name in ("previous_action", "joints"))
        return self.targets(decision, sent, joints)

    def targets(self, decision: np.ndarray, sent: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Joint targets (`every`, A) float64 [rad] for the next control periods.

        Args:
            decision: Output of the network (M,).
            sent: Last targets (A,) [rad].
            joints: Positions of the joints (A,) [rad].
        """
        wanted = np.clip(np.asarray(decision, np.float64), -1.0, 1.0)
        goal = self._rest.copy()
        moved = self._single
        goal[moved] = sent[moved] + self._step_rad * wanted[self.size - len(moved) :]
        if self._palm is not None:
            arm = self._palm.arm
            change = self._palm.moved(sent, self._step_m * wanted[:3]) - sent[arm]
            goal[arm] = sent[arm] + np.clip(change, -self._step_rad, self._step_rad)
            moved = np.concatenate([arm, moved])
        goal[moved] = np.clip(goal[moved], joints[moved] - self._lead, joints[moved] + self._lead)
        shares = np.arange(1, self.every + 1)[:, None] / self.every
        found = np.tile(goal, (self.every, 1))
        found[:, moved] = sent[moved] + (goal[moved] - sent[moved]) * shares
        return found


def _flat(inputs: Fields, channels: tuple[Channel, ...]) -> np.ndarray:
    """Concatenate the channels of inputs for the network, (B, N) float32."""
    parts = [inputs[channel.name].reshape(len(inputs[channel.name]), -1) for channel in channels]
    return np.concatenate(parts, axis=1, dtype=np.float32)


def _raw(inputs: Fields, channels: tuple[Channel, ...], name: str) -> np.ndarray:
    """The single sample of a plain channel as observed, (K,) float64."""
    channel = next(channel for channel in channels if channel.name == name)
    sample = inputs[name].reshape(-1).astype(np.float64)
    return sample * np.array(channel.scale) + np.array(channel.mean) if channel.scale else sample


class _Palm:
    """Moves the palm of a limb by damped least squares on its own kinematics."""

    def __init__(
        self, robot: RobotModel, limb: str, names: tuple[str, ...], home: np.ndarray, turn: np.ndarray
    ) -> None:
        self._model = robots.load(robot.model).compile()
        self._data = mujoco.MjData(self._model)
        own = robot.limbs[limb]
        self._site = self._model.site(robot.frames[own.palm]).id
        self._address = np.array([self._model.joint(name).qposadr[0] for name in names])
        self.arm = np.array([number for number, joint in enumerate(robot.joints) if joint.name in own.arm])
        self._dofs = np.array([self._model.joint(names[number]).dofadr[0] for number in self.arm])
        self._home = home[self.arm]
        self._jacobian = np.zeros((6, self._model.nv))
        self._tips = [self._model.site(robot.frames[role]).id for role in own.tips or (own.palm,)]
        self._origin = np.zeros(6)
        self._origin = self.places(home).astype(np.float64) * PLACE_M
        self._upright = quaternions.to_matrix(turn) if len(turn) else self._pose(home)[1].copy()

    def moved(self, joints: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Arm joints [rad] that move the palm from its position at `joints` (A,) by `way` (3,) [m] in the base."""
        found = joints.copy()
        goal = self._pose(found)[0] + way
        for _ in range(ITERATIONS):
            place, turn = self._pose(found)
            mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._site)
            error = np.concatenate([goal - place, RADIAN_M * _turn(self._upright, turn)])
            jacobian = self._jacobian[:, self._dofs] * np.array([1, 1, 1, RADIAN_M, RADIAN_M, RADIAN_M])[:, None]
            inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + DAMPING**2 * np.eye(6))
            change = POSTURE * (self._home - found[self.arm])
            found[self.arm] += inverse @ error + change - inverse @ (jacobian @ change)
        return np.asarray(found[self.arm])

    def places(self, joints: np.ndarray) -> np.ndarray:
        """Palm and mean fingertip (6,) float32 in the base, relative to home, in units of `PLACE_M`."""
        palm, _ = self._pose(joints)
        found = np.concatenate([palm, self._data.site_xpos[self._tips].mean(axis=0)])
        return np.asarray((found - self._origin) / PLACE_M, np.float32)

    def _pose(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._data.qpos[self._address] = joints
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        return self._data.site_xpos[self._site].copy(), self._data.site_xmat[self._site].reshape(3, 3)


def _turn(wanted: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] from `now` to `wanted`, limited to `TURN_RAD`."""
    quaternion, found = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, (wanted @ now.T).ravel())
    mujoco.mju_quat2Vel(found, quaternion, 1.0)
    return np.asarray(found * min(1.0, TURN_RAD / max(float(np.linalg.norm(found)), 1e-9)))
