"""Inputs and actions of a reinforcement-learned policy: small steps of the palm or of joints.

A decision lasts for several control periods, over which the joint targets move linearly to its goal. It depends only on
the last targets and the joint positions, so that no state is kept between decisions.
"""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.geometry import quaternions, transforms
from dextera_build.policy.features import Fields
from dextera_build.sim.model import robot as robots

ITERATIONS = 3
"""Newton steps towards a nearby pose of the palm."""
DAMPING = 0.05
"""Weight of a radian of arm motion, relative to a metre of the palm."""
RADIAN_M = 0.3
"""Weight of a radian of palm rotation, relative to a metre of the palm."""
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
        """The network's input for samples of every channel, (B, N) float32."""
        plain, palm = _flat(inputs, self._channels), self._palm
        if palm is None:
            return plain
        joints = _raw(inputs, self._channels, "joints")
        return np.concatenate([plain, np.stack([palm.places(each) for each in joints])], axis=1)

    def steered(self, decision: np.ndarray, inputs: Fields) -> np.ndarray:
        """`targets` with the joints and last targets of `inputs`."""
        sent, joints = (_raw(inputs, self._channels, name)[0] for name in ("previous_action", "joints"))
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
    """The samples of a plain channel as observed, (B, K) float64."""
    channel = next(channel for channel in channels if channel.name == name)
    sample = inputs[name].reshape(len(inputs[name]), -1).astype(np.float64)
    return sample * np.array(channel.scale) + np.array(channel.mean) if channel.scale else sample


class _Palm:
    """The palm of a limb: where it is, and joints that move it."""

    def __init__(
        self, robot: RobotModel, limb: str, names: tuple[str, ...], home: np.ndarray, turn: np.ndarray
    ) -> None:
        # The solver is imported here, because joints are steered without one.
        from dextera_build.sim.control import ik

        self._kinematics = ik.ArmKinematics(robot, limb, ik.Costs(1.0, RADIAN_M, DAMPING))
        self.arm = np.array([names.index(name) for name in self._kinematics.joints])
        self._home = home[self.arm]
        self._upright = quaternions.to_matrix(turn) if len(turn) else self._kinematics.pose(self._home)[:3, :3]
        self._model = robots.load(robot.model).compile()
        self._data = mujoco.MjData(self._model)
        own = robot.limbs[limb]
        self._robot, self._names = robot, names
        moved = robot.followed(dict.fromkeys(names, 0.0))
        self._address = np.array([self._model.joint(name).qposadr[0] for name in moved])
        self._sites = [self._model.site(robot.frames[role]).id for role in (own.palm, *(own.tips or (own.palm,)))]
        self._origin = self._points(home)

    def moved(self, joints: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Arm joints [rad] that move the palm from its position at `joints` (A,) by `way` (3,) [m] in the base."""
        found = joints[self.arm]
        goal = self._kinematics.pose(found)[:3, 3] + way
        for _ in range(ITERATIONS):
            target = transforms.rigid(_turned(self._kinematics.pose(found)[:3, :3], self._upright), goal)
            found = self._kinematics.step(target, found, found + POSTURE * (self._home - found))
        return np.asarray(found)

    def places(self, joints: np.ndarray) -> np.ndarray:
        """Palm and mean fingertip (6,) float32 in the base, relative to home, in units of `PLACE_M`."""
        return np.asarray((self._points(joints) - self._origin) / PLACE_M, np.float32)

    def _points(self, joints: np.ndarray) -> np.ndarray:
        followed = self._robot.followed(dict(zip(self._names, joints.tolist(), strict=True)))
        self._data.qpos[self._address] = list(followed.values())
        mujoco.mj_kinematics(self._model, self._data)
        palm, tips = self._data.site_xpos[self._sites[0]], self._data.site_xpos[self._sites[1:]]
        return np.concatenate([palm, tips.mean(axis=0)])


def _turned(now: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) from `now` towards `wanted` by at most `TURN_RAD`."""
    angle = transforms.angle(now.T @ wanted)
    if angle <= TURN_RAD:
        return wanted
    first, last = quaternions.from_matrix(now), quaternions.from_matrix(wanted)
    return quaternions.to_matrix(quaternions.slerp(first, last, TURN_RAD / angle))
