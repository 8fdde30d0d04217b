"""simulate.identified with MuJoCo."""

from __future__ import annotations

from typing import Any

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate, JointDynamics
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import machine
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import at_home, compile_folder

BACKEND = Backend(
    summary="MuJoCo: masses, friction and actuators of the model", profiles=("cpu",), packages=("mujoco",), extra="twin"
)


def model(ctx: Context, bundle: TaskBundle, dynamics: DynamicsEstimate, options: Options) -> Folder:
    """The model with what was identified."""
    spec, before = machine.load(bundle.model), compile_folder(bundle.model)
    home = at_home(before)
    positions = {before.joint(number).name: home.joint(number).qpos.copy() for number in range(before.njnt)}
    for name, thing in dynamics.objects.items():
        root = spec.body(name)
        bodies = [root, *root.find_all("body")]
        if thing.mass_kg.identified:
            factor = thing.mass_kg.value / float(before.body_subtreemass[before.body(name).id])
            for body in bodies:
                _heavier(body, before, factor)
        if thing.friction.identified:
            for geom in [geom for body in bodies for geom in body.geoms]:
                geom.friction[0] = thing.friction.value
    for name, joint in dynamics.joints.items():
        _control(spec.actuator(ROBOT + name), joint)
        if joint.friction.identified:
            spec.joint(ROBOT + name).frictionloss = joint.friction.value
    return machine.finish(spec, positions, home, bundle.model.files)


def _heavier(body: Any, before: Any, factor: float) -> None:
    """Multiply mass and inertia, which may follow from geoms."""
    number = before.body(body.name).id
    body.explicitinertial = True
    body.mass, body.inertia = factor * before.body_mass[number], factor * before.body_inertia[number]
    body.ipos, body.iquat = before.body_ipos[number], before.body_iquat[number]


def _control(actuator: Any, joint: JointDynamics) -> None:
    stiffness = float(actuator.gainprm[0])
    lag_s = -float(actuator.biasprm[2]) / stiffness
    if joint.stiffness.identified:
        stiffness = joint.stiffness.value
    if joint.lag_s.identified:
        lag_s = joint.lag_s.value
    actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = stiffness, -stiffness, -stiffness * lag_s
