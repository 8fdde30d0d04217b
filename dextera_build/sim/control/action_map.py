"""Conversion of actions of every kind to joint targets, and back."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import ActionKind, TaskSpec
from dextera_build.errors import MachineError, install_extra, listing
from dextera_build.geometry import lie
from dextera_build.policy import actions
from dextera_build.sim.model.forward import Kinematics

if TYPE_CHECKING:
    from dextera_build.sim.control.operator import PoseControl


SOLVER = ("mink", "daqp")
"""Packages that inverse kinematics needs; extra `learn` has them, extra `env` does not."""


class ActionMap:
    """Maps actions of one kind to a robot's joints.

    Both directions are pure functions of their arguments, so that an action is independent of earlier ones. In kind
    `end_effector`, redundant arms move towards home, so that joint targets converted to actions and back have the same
    palm pose, but possibly another posture.

    Args:
        task: The task, with the rate and the default kind.
        robot: The embodiment.
        kind: Another kind; None: the task's.

    Raises:
        RuleError: There is no such kind, or the robot has no palm.
    """

    def __init__(self, task: TaskSpec, robot: RobotModel, kind: ActionKind | None = None) -> None:
        self.spec = actions.of_task(task, robot, kind)
        """Names, limits and rate of the actions."""
        self._robot, self._names = robot, [joint.name for joint in robot.joints]
        self._palms: tuple[str, ...] = ()
        self._control: PoseControl | None = None
        if self.spec.kind == "end_effector":
            self._palms, self._fingers = actions.palms_of(robot), actions.fingers_of(robot)
            self._kinematics = Kinematics(robot)

    def solve(self) -> None:
        """Prepare the inverse kinematics that `targets` of kind `end_effector` needs.

        Raises:
            MachineError: The solver is not installed.
        """
        if self.spec.kind != "end_effector" or self._control is not None:
            return
        missing = [name for name in SOLVER if importlib.util.find_spec(name) is None]
        if missing:
            raise MachineError(
                "actions of kind `end_effector` need inverse kinematics, which is not installed",
                code="DXB-E430",
                facts={"missing": listing(missing)},
                hint=f"{install_extra('learn')}; `joint` and `delta` need neither",
            )
        from dextera_build.sim.control.operator import PoseControl

        self._control = PoseControl(self._robot, self.spec.rate_hz)

    def fault(self, action: np.ndarray) -> str:
        """Reason why an action cannot be sent; empty if it can."""
        spec = self.spec
        if action.shape != spec.lower.shape:
            return f"the action has shape {action.shape}, but kind `{spec.kind}` has {len(spec.names)} numbers"
        finite = np.isfinite(action)
        return "" if finite.all() else f"the action for `{spec.names[int(finite.argmin())]}` is not a finite number"

    def targets(self, action: np.ndarray, sent: np.ndarray) -> np.ndarray:
        """Joint targets (A,) [rad] of an action (N,), clipped to its limits.

        Args:
            action: An action without a fault.
            sent: Previously sent joint targets (A,) [rad].

        Raises:
            MachineError: The solver of kind `end_effector` is not installed.
        """
        # `np.clip` takes twice as long.
        found = np.asarray(np.minimum(np.maximum(np.asarray(action, np.float64), self.spec.lower), self.spec.upper))
        if self.spec.kind == "joint":
            return found
        if self.spec.kind == "delta":
            return np.asarray(sent + found)
        self.solve()
        assert self._control is not None
        from dextera_build.sim.control.operator import Aim, Command

        posture = np.array(sent, np.float64)
        posture[self._fingers] = found[6 * len(self._palms) :]
        aims = {}
        changes = found[: 6 * len(self._palms)].reshape(-1, 6)
        for limb, pose, change in zip(self._palms, self._poses(sent), changes, strict=True):
            palm = lie.retract(pose, change)
            hand = [self._names.index(name) for name in self._robot.limbs[limb].hand]
            aims[limb] = Aim(palm, posture[hand])
        self._control.begin(sent)
        return self._control.follow(Command(aims, "action"))

    def actions(self, targets: np.ndarray, sent: np.ndarray) -> np.ndarray:
        """The action (N,) that produces joint targets (A,) [rad], not clipped to its limits.

        Args:
            targets: Joint targets (A,) [rad].
            sent: Previously sent joint targets (A,) [rad].
        """
        if self.spec.kind == "joint":
            return np.array(targets)
        if self.spec.kind == "delta":
            return np.asarray(targets - sent)
        parts = []
        for before, after in zip(self._poses(sent), self._poses(targets), strict=True):
            parts.append(lie.between(before, after))
        return np.concatenate([*parts, targets[self._fingers]])

    def _poses(self, targets: np.ndarray) -> list[np.ndarray]:
        """T_base_palm (4, 4) of every limb with a palm at joint targets (A,)."""
        self._kinematics.pose(dict(zip(self._names, targets.tolist(), strict=True)))
        return [self._kinematics.frame(self._robot.limbs[limb].palm) for limb in self._palms]
