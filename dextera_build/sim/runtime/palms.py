"""Poses of the palms from encoder readings, and the terms of projects, which may be computed from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses, transforms
from dextera_build.policy.added import AddedTerm, AddedTerms
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.seen import Embodied
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.primitives.grasp import Hands
from dextera_build.sim.render.robot_pixels import pose_robot


class Palms:
    """Forward kinematics of the palms, independent of the calibration of the base.

    Args:
        robot: The embodiment.
        model: Compiled model of a task with it.
    """

    def __init__(self, robot: RobotModel, model: mujoco.MjModel) -> None:
        self._robot, self._model = robot, model
        self._palms = Hands(model, robot, ROBOT).palms
        self._base = model.body(ROBOT + "base").id
        self._data = mujoco.MjData(model)

    def __call__(self, joints: np.ndarray) -> np.ndarray:
        """Poses in the base (N, L, 7) at joint positions (N, A) [rad]; the identity for a missing palm."""
        found = np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(joints), len(self._palms), 1))
        data = self._data
        for rows, positions in zip(found, joints, strict=True):
            pose_robot(self._robot, data, positions)
            mujoco.mj_kinematics(self._model, data)
            base_from_world = transforms.invert(_motion(data.xmat[self._base], data.xpos[self._base]))
            for row, palm in zip(rows, self._palms, strict=True):
                if palm >= 0:
                    world_from_palm = _motion(data.site_xmat[palm], data.site_xpos[palm])
                    row[:] = poses.from_matrix(base_from_world @ world_from_palm)
        return found


def _motion(rotation: Any, position: Any) -> np.ndarray:
    return transforms.rigid(rotation.reshape(3, 3), position)


def added(bundle: TaskBundle, model: mujoco.MjModel, terms: Sequence[AddedTerm]) -> AddedTerms | None:
    """The terms that are added to a task, or None if there are none.

    Args:
        bundle: The task.
        model: Its compiled model.
        terms: Declarations and functions.

    Raises:
        RuleError: Two terms have the same name.
    """
    if not terms:
        return None
    target, base = list(bundle.objects).index(bundle.task.object), bundle.base_pose.matrix
    layout = of_bundle(bundle, terms=[term.spec for term in terms])
    return AddedTerms(terms, layout, Embodied(target, Palms(bundle.robot, model), base))
