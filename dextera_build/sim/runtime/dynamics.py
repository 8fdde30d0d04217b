"""Apply a start to a compiled model: base, sizes, masses, friction, gains, damping and friction of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.robot_base import RobotBase
from dextera_build.sim.model.sizes import Sizes
from dextera_build.sim.runtime import variations


class Dynamics:
    """Keeps a model's original values and applies every start to them, never to an earlier start's values.

    Args:
        bundle: The task.
        model: Its compiled model, modified by `apply`.
    """

    def __init__(self, bundle: TaskBundle, model: Any) -> None:
        self._model = model
        self._sizes = Sizes(bundle.objects, model)
        self.base = RobotBase(bundle.base_pose.matrix, model)
        self._mass, self._inertia = model.body_mass.copy(), model.body_inertia.copy()
        self._friction = model.geom_friction.copy()
        self._gain, self._bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        self._damping, self._stick = model.dof_damping.copy(), model.dof_frictionloss.copy()
        self._actuators = [model.actuator(ROBOT + joint.name).id for joint in bundle.robot.joints]
        self._gain_share = np.array([bundle.gain_share.get(joint.name, 1.0) for joint in bundle.robot.joints])
        roots = model.body_rootid
        self._bodies = {name: np.flatnonzero(roots == model.body(name).id) for name in bundle.objects}
        owners = model.body_rootid[model.dof_bodyid]
        self._dofs = {name: owners == model.body(name).id for name in bundle.objects}
        self._dofs[variations.ROBOT] = owners == model.body(ROBOT + "base").id
        self._geoms = {name: np.isin(model.geom_bodyid, bodies) for name, bodies in self._bodies.items()}

    def shape(self, size_scale: Mapping[str, float], base_error: Sequence[float]) -> None:
        """Set only the properties that affect collisions: the objects' sizes and the robot's base."""
        self._sizes.put(size_scale)
        self.base.put(self._model, base_error)

    def apply(self, start: Start, data: Any) -> None:
        """Set base, sizes, masses, inertias, friction and gains of `start`."""
        model = self._model
        self.shape(start.size_scale, start.base_error)
        model.body_mass[:], model.body_inertia[:] = self._mass, self._inertia
        model.geom_friction[:] = self._friction
        for name, factor in start.mass_scale.items():
            model.body_mass[self._bodies[name]] *= factor
            model.body_inertia[self._bodies[name]] *= factor * start.size_scale.get(name, 1.0) ** 2
        for name, friction in start.friction.items():
            model.geom_friction[self._geoms[name], 0] = friction
        model.actuator_gainprm[:], model.actuator_biasprm[:] = self._gain, self._bias
        gains = 1.0 + self._gain_share * (start.gain_scale - 1.0)
        model.actuator_gainprm[self._actuators, 0] *= gains
        model.actuator_biasprm[self._actuators, 1:3] *= gains[:, None]
        model.dof_damping[:], model.dof_frictionloss[:] = self._damping, self._stick
        for name, factor in start.variation.damping.items():
            model.dof_damping[self._dofs[name]] *= factor
        for name, factor in start.variation.joint_friction.items():
            model.dof_frictionloss[self._dofs[name]] *= factor
        # Constants derived from masses; MuJoCo needs a scratch `MjData`, which it leaves at `qpos0`.
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
