"""Inputs and actions of a reinforcement-learned policy: small steps of palms, of fingers together, or of joints.

A decision lasts for several control periods, over which the joint targets move linearly to its goal. It depends only on
the last targets and the joint positions, so that no state is kept between decisions.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.geometry import lie, quaternions, transforms
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
CLOSING = 0.5
"""Maximum fraction of the way from open to closed fingers per decision."""
POSTURE = 0.02
"""Fraction of the way home that the arm's redundancy moves per Newton step."""


class Steering:
    """Maps decisions (M,), each -1 to 1, to joint targets.

    With `control` "palm" the first three decisions move the palm of the first of `limb` along the axes of the robot's
    base by up to `step_m`, while it turns to the quaternion `palm_w` ... `palm_z` in the base, or keeps its home
    orientation without one. With `turn_rad` three more turn it about these axes by up to that angle instead. Those of
    further limbs follow. Then one decision for each of `grip` closes or opens the hand of a limb. All other decisions
    move the target of one joint by up to `step_rad`. Uncontrolled joints go to the contract's mean. With "palm" the
    network's input also contains the positions of the palms and of their mean fingertips, so kinematics need not be
    learned.

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
        self.limbs = tuple(str(settings.get("limb", robot.limb_names[0])).split())
        """The limbs whose palms move."""
        palm, grips = settings["control"] == "palm", str(settings.get("grip", "")).split()
        self._palms = [_Palm(robot, limb, names, self._rest, turn) for limb in self.limbs] if palm else []
        hands = [robot.limbs[limb].grips[grip] for limb, grip in zip(self.limbs, grips, strict=False)]
        self._fingers = [_Fingers(grip.closed, names, self._rest) for grip in hands]
        self._turn_rad = float(settings.get("turn_rad", 0.0))
        self._each = 6 if self._turn_rad else 3
        self.size = len(self._palms) * self._each + len(self._fingers) + len(self._single)
        self._channels = contract.inputs

    def numbers(self, inputs: Fields) -> np.ndarray:
        """The network's input for samples of every channel, (B, N) float32."""
        plain = _flat(inputs, self._channels)
        if not self._palms:
            return plain
        joints = _raw(inputs, self._channels, "joints")
        places = [np.stack([palm.places(each) for each in joints]) for palm in self._palms]
        return np.concatenate([plain, *places], axis=1)

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
        goal[self._single] = sent[self._single] + self._step_rad * wanted[self.size - len(self._single) :]
        for number, palm in enumerate(self._palms):
            way = wanted[number * self._each : (number + 1) * self._each]
            change = palm.moved(sent, self._step_m * way[:3], self._turn_rad * way[3:]) - sent[palm.arm]
            goal[palm.arm] = sent[palm.arm] + np.clip(change, -self._step_rad, self._step_rad)
        for closing, fingers in zip(wanted[len(self._palms) * self._each :], self._fingers, strict=False):
            goal[fingers.joints] = fingers.moved(sent, closing)
        moved = np.concatenate(
            [*(each.arm for each in self._palms), *(each.joints for each in self._fingers), self._single]
        )
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

    def moved(self, joints: np.ndarray, way: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Arm joints [rad] that move the palm from its pose at `joints` (A,) in the base.

        Args:
            joints: Positions of the joints (A,) [rad].
            way: Where to (3,) [m].
            turn: Rotation vector (3,) [rad]; empty: towards its fixed orientation.
        """
        found = joints[self.arm]
        start = self._kinematics.pose(found)
        goal = start[:3, 3] + way
        upright = lie.rotation(turn) @ start[:3, :3] if len(turn) else self._upright
        for _ in range(ITERATIONS):
            target = transforms.rigid(_turned(self._kinematics.pose(found)[:3, :3], upright), goal)
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


class _Fingers:
    """The fingers of a hand, on the way from where they rest to the closed posture of a grip."""

    def __init__(self, closed: Mapping[str, float], names: tuple[str, ...], rest: np.ndarray) -> None:
        moved = [name for name, end in closed.items() if name in names and end != rest[names.index(name)]]
        self.joints = np.array([names.index(name) for name in moved], int)
        self._open = rest[self.joints]
        self._way = np.array([closed[name] for name in moved]) - self._open

    def moved(self, sent: np.ndarray, closing: float) -> np.ndarray:
        """Targets of `joints` [rad], farther on the way than those of `sent` (A,) by up to `CLOSING`."""
        share = (sent[self.joints] - self._open) @ self._way / (self._way @ self._way)
        return np.asarray(self._open + np.clip(share + CLOSING * closing, 0.0, 1.0) * self._way)


def _turned(now: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) from `now` towards `wanted` by at most `TURN_RAD`."""
    angle = transforms.angle(now.T @ wanted)
    if angle <= TURN_RAD:
        return wanted
    first, last = quaternions.from_matrix(now), quaternions.from_matrix(wanted)
    return quaternions.to_matrix(quaternions.slerp(first, last, TURN_RAD / angle))
