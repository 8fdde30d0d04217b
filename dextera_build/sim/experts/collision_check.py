"""Collision checks of plans."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.sim.control.ik import Solution
from dextera_build.sim.control.operator import Aim, Command, State
from dextera_build.sim.experts.motion import Leg, Plan
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment

ENOUGH_RAD = 0.35
"""Distance to the joint limits beyond which comfort no longer increases [rad]."""
TOUCH_M = 0.004
"""Allowed penetration between hand and task object during intended contact [m]."""
CLEAR_M = 0.010
"""Clearance of the robot from everything else [m]."""
LAG_M = 0.015
"""Allowed lag of the palms behind their commands on a path [m]."""
CLOSING_M = 0.003
"""Clearance of closing fingers from everything but the object [m]."""
RESTARTS = 3
"""Further starts of the inverse kinematics for the first pose of a plan."""
OUT_OF_REACH = "the arm does not reach the pose of the hand"
"""A reason of `refused`."""
EVERY = 2
"""Control steps between collision checks along a path."""


class CollisionCheck:
    """Checks plans against the collision shapes of a task's model; objects do not move.

    Args:
        environment: The task; only its model is used.
        reach: Kinematics of the limbs that may move; the others stay in place.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        model = environment.known_model()
        self._model, self._reach, self._rate = model, reach, environment.task.control_hz
        self._data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self._data, 0)
        self._base = environment.bundle.base_pose.matrix
        self.up = environment.bundle.base_pose.inverse().matrix[:3, 2].copy()
        """Vertical in the robot's base, (3,)."""
        roots = model.body_rootid[model.geom_bodyid]
        self._robot = roots == model.body(ROBOT + "base").id
        self._object = roots == model.body(environment.task.object).id
        # Contacts are reported below this distance.
        model.geom_margin[self._robot] = CLEAR_M
        self._joints = self._addresses([joint.name for joint in environment.bundle.robot.joints])
        self._led = environment.bundle.robot.followers
        self._hit = ""
        self.refused: Counter[str] = Counter()
        """Why plans were refused so far, and how often."""

    def comfort(self, phases: Sequence[Plan], state: State) -> float | None:
        """Comfort of the arms along a plan, higher is better; None if unreachable or in collision.

        After the first contact objects move with the hand, which only a rehearsal can verify.

        Args:
            phases: The plan.
            state: Poses of the robot and the objects.
        """
        found = self._judged(phases, state)
        if isinstance(found, str):
            self.refused[found] += 1
            return None
        return found

    def _judged(self, phases: Sequence[Plan], state: State) -> float | str:
        """Comfort, or why there is none."""
        self._place(state)
        plan = phases[0]
        reach = self._reach.some(tuple(plan))
        rows = list(zip(*plan.values(), strict=True))
        first = next(number for number, legs in enumerate(rows) if any(leg.contact for leg in legs))
        seed: np.ndarray | None = None
        margin, far = np.inf, 0.0
        # The most frequent failures first: the grasp, then the approach, then the end.
        for legs in (rows[first], *reversed(rows[:first]), *rows[first + 1 : first + 2], rows[-1]):
            solved = self._solved(reach, legs, seed)
            if solved is None:
                return OUT_OF_REACH
            if legs is rows[first] and not self._grasps(reach, solved.joints, rows[first:]):
                return self._hit
            seed = solved.joints
            margin, far = min(margin, solved.margin_rad), max(far, float(np.abs(seed - reach.arm.home).max()))
        for later in phases[1:]:
            more = self._reach.some(tuple(later))
            seed = seed if more is reach else None
            for legs in zip(*later.values(), strict=True):
                if self._solved(more, legs, seed) is None and self._solved(more, legs, None) is None:
                    return OUT_OF_REACH
        if not self._clear(reach, plan, first, state):
            return self._hit
        return 3.0 * min(margin, ENOUGH_RAD) - far

    def _grasps(self, reach: Reach, joints: np.ndarray, rows: Sequence[Sequence[Leg]]) -> bool:
        """Whether nothing but the object is in contact with closing hands at the first contact."""
        if not self._free(reach, joints, rows[0], object_m=-TOUCH_M):
            return False
        closing = rows[1] if len(rows) > 1 and rows[1][0].segment == "grasp" else rows[0]
        return self._free(reach, joints, closing, object_m=-np.inf)

    def _solved(self, reach: Reach, legs: Sequence[Leg], seed: np.ndarray | None) -> Solution | None:
        """The arms' joints at the ends of legs, or None."""
        palms = np.array([leg.palm for leg in legs])
        solved = reach.arm.solve(palms, seed, restarts=RESTARTS if seed is None else 0, posture=reach.arm.home)
        return solved if solved.reached() else None

    def _clear(self, reach: Reach, plan: Plan, first: int, state: State) -> bool:
        """Whether the arms' path is free of collisions until the object moves."""
        joints = reach.joints(state)
        begun = {limb: legs[: first + 1] for limb, legs in plan.items()}
        commands: list[Command] = list(reach.commands(begun, state, self._rate))
        for number, command in enumerate(commands):
            aims = [command.aims[limb] for limb in reach.limbs]
            joints = reach.arm.track(np.array([aim.palm for aim in aims]), joints, 1.0 / self._rate)
            looked = number % EVERY == 0 or number == len(commands) - 1
            near = -TOUCH_M if command.contact else CLEAR_M
            if looked and not _follows(reach, joints, aims):
                self._hit = "the arm does not follow the way"
                return False
            if looked and not self._free(reach, joints, aims, object_m=near):
                return False
        return True

    def _place(self, state: State) -> None:
        self._data.qpos[self._joints] = state.joints
        for name, pose in state.objects.items():
            world = self._base @ pose
            place = self._data.joint(name).qpos
            place[:3], place[3:] = world[:3, 3], quaternions.from_matrix(world[:3, :3])
        for name, position in state.displacement.items():
            self._data.joint(name).qpos[0] = position

    def _free(self, reach: Reach, joints: np.ndarray, aims: Sequence[Leg | Aim], *, object_m: float) -> bool:
        """Whether nothing collides with the arms at `joints` (A,) and the fingers as in `aims`, by limb.

        The task's object may be as near as `object_m` [m], negative inside; at minus infinity a hand closes on it, and
        its fingers may touch each other.
        """
        model, data = self._model, self._data
        data.qpos[self._joints[reach.places(reach.arm.joints)]] = joints
        for limb, aim in zip(reach.limbs, aims, strict=True):
            data.qpos[self._joints[reach.places(reach.one(limb).fingers.joints)]] = aim.fingers
        for each in self._led:
            leader = float(data.joint(ROBOT + each.leader).qpos[0])
            data.joint(ROBOT + each.name).qpos[0] = each.ratio * leader + each.offset
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact[: data.ncon]:
            one, other = contact.geom
            if not (self._robot[one] or self._robot[other]):
                continue
            apart = CLEAR_M if np.isfinite(object_m) else CLOSING_M
            if self._robot[one] and self._robot[other]:
                apart = 0.0 if np.isfinite(object_m) else object_m
            elif self._object[one] or self._object[other]:
                apart = object_m
            if contact.dist < apart:
                self._hit = self._said(one, other)
                return False
        return True

    def _said(self, one: int, other: int) -> str:
        """Two geoms that touch, in words."""
        bodies = [int(self._model.geom_bodyid[geom]) for geom in ((one, other) if self._robot[one] else (other, one))]
        own, thing = (self._model.body(body).name.removeprefix(ROBOT) for body in bodies)
        return f"`{own}` would touch {'the scene' if thing == 'world' else f'`{thing}`'}"

    def _addresses(self, names: Sequence[str]) -> np.ndarray:
        return np.array([self._model.joint(ROBOT + name).qposadr[0] for name in names], int)


def _follows(reach: Reach, joints: np.ndarray, aims: Sequence[Aim]) -> bool:
    """Whether the palms at arm joints `joints` (A,) are at their commanded poses."""
    lag = reach.arm.poses(joints)[:, :3, 3] - np.array([aim.palm[:3, 3] for aim in aims])
    return float(np.linalg.norm(lag, axis=1).max()) < LAG_M
