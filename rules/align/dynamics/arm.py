"""A robot alone, without contacts: its hands are rigid, and may carry a payload or be pushed back.

Position-controlled arms are contracting, so that an episode can be simulated from its first measurement to its end:
errors of the state fade out with the lag of the joints, about 0.1 s.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import machine
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.runtime.environment import RAMP

from .phases import Phases

PAYLOAD = "payload_"
"""Prefix of the bodies that become what a hand carries."""


@dataclass(frozen=True)
class Payload:
    """An object of the twin as a rigid body, joints as in the photograph."""

    mass_kg: float
    centre: np.ndarray
    """Centre of mass (3,) in its frame [m]."""
    inertia: float
    """Mean moment of inertia about it [kg m^2]."""


@dataclass(frozen=True)
class Run:
    """One recording: row t was measured before target t + 1 was sent."""

    joints: np.ndarray
    """Measured positions of the arms' joints (T, J) [rad or m]."""
    targets: np.ndarray
    """What was sent before, and in each control period (T + 1, J) [rad or m]."""
    phases: Phases
    points: np.ndarray
    """Centre of mass of the object (T, 3) in the world, about where it is pushed [m]."""
    ways: np.ndarray
    """Direction (T, 3) in the world in which it slides; zeros where it does not."""
    rates: np.ndarray
    """Acceleration (T, 3) of the hand in the world [m/s^2], with which it slides."""


@dataclass(frozen=True)
class Values:
    """What is estimated."""

    log_stiffness: np.ndarray
    """Factors on the stiffness of joints (J,)."""
    log_lag: np.ndarray
    """Factors on damping / stiffness (J,)."""
    friction: np.ndarray
    """Dry friction as a fraction of the joint's maximum torque (J,)."""
    latency_s: float
    log_mass: float = 0.0
    """Factor on the mass of the object."""
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Error (3,) of its centre of mass in the frame of the palm [m]."""
    mu: float = 0.5
    """Friction of object and support."""
    lifted: float = 0.0
    """Fraction of its weight that a pushing hand takes off the support."""


class Arm:
    """Simulates the arms of a task's robot.

    Args:
        bundle: The task in the twin.

    Raises:
        RuleError: MuJoCo cannot load the model, or cannot do without the joints of the hands.
    """

    def __init__(self, bundle: TaskBundle) -> None:
        self.joints = [joint for joint in bundle.robot.joints if joint.group == "arm"]
        self.payload = _payload(bundle)
        self.model = _alone(bundle)
        self.data = mujoco.MjData(self.model)
        model, names = self.model, [ROBOT + joint.name for joint in self.joints]
        self._actuators = np.array([model.actuator(name).id for name in names])
        self._qpos = np.array([model.joint(name).qposadr[0] for name in names])
        self._dofs = np.array([model.joint(name).dofadr[0] for name in names])
        self._efforts = np.array([joint.effort for joint in self.joints])
        self._gain, self._bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        robot = bundle.robot
        self._sites = {
            name: int(model.site(ROBOT + robot.frames[limb.palm]).id) for name, limb in robot.limbs.items() if limb.palm
        }
        self._steps = max(1, round(1.0 / (bundle.task.control_hz * model.opt.timestep)))
        pieces = min(RAMP, self._steps)
        upto = [self._steps * piece // pieces for piece in range(pieces + 1)]
        self._pieces = [(piece / pieces, upto[piece] - upto[piece - 1]) for piece in range(1, pieces + 1)]
        self._from_base = transforms.invert(bundle.base_pose.matrix)

    @property
    def friction(self) -> np.ndarray:
        """Dry friction of the joints in the model, as fractions of their maximum torques (J,)."""
        return np.asarray(self.model.dof_frictionloss[self._dofs] / self._efforts)

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the joints in the model (J,) [N m/rad or N/m]."""
        return np.asarray(self._gain[self._actuators, 0])

    @property
    def lags(self) -> np.ndarray:
        """Damping / stiffness of the joints in the model (J,) [s]."""
        return np.asarray(-self._bias[self._actuators, 2] / self.stiffness)

    def palms(self, joints: np.ndarray) -> dict[str, np.ndarray]:
        """Limb -> T_base_palm (T, 4, 4) at joint positions (T, J)."""
        model, data = self.model, self.data
        found: dict[str, list[np.ndarray]] = {name: [] for name in self._sites}
        for row in joints:
            data.qpos[self._qpos] = row
            mujoco.mj_kinematics(model, data)
            for name, site in self._sites.items():
                pose = transforms.rigid(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])
                found[name].append(self._from_base @ pose)
        return {name: np.array(each) for name, each in found.items()}

    def simulate(self, run: Run, values: Values) -> np.ndarray:
        """Positions of the joints (T, J) [rad or m], the first as measured."""
        model, data = self.model, self.data
        self._set(values)
        mujoco.mj_resetData(model, data)
        data.qpos[self._qpos] = run.joints[0]
        loads = self._loads(run, values)
        latency = values.latency_s / (self._steps * model.opt.timestep)
        knots = np.arange(len(run.targets))
        times = np.arange(len(run.joints) - 1)[:, None] + [[part - latency for part, _ in self._pieces]]
        sent = np.stack([np.interp(times, knots, each) for each in run.targets.T], axis=-1)
        found = np.empty_like(run.joints)
        found[0] = run.joints[0]
        mujoco.mj_forward(model, data)
        for row in range(len(sent)):
            loads(row)
            for target, (_, steps) in zip(sent[row], self._pieces, strict=True):
                data.ctrl[self._actuators] = target
                mujoco.mj_step(model, data, steps)
            found[row + 1] = data.qpos[self._qpos]
        return found

    def _set(self, values: Values) -> None:
        model, stiff = self.model, np.exp(values.log_stiffness)
        model.actuator_gainprm[self._actuators, 0] = self._gain[self._actuators, 0] * stiff
        model.actuator_biasprm[self._actuators, 1] = self._bias[self._actuators, 1] * stiff
        damped = stiff * np.exp(values.log_lag)
        model.actuator_biasprm[self._actuators, 2] = self._bias[self._actuators, 2] * damped
        model.dof_frictionloss[self._dofs] = np.maximum(values.friction, 0.0) * self._efforts

    def _loads(self, run: Run, values: Values) -> Any:
        """Sets the load of a control period."""
        model, data, phases = self.model, self.data, run.phases
        for limb in self._sites:
            self._hang(limb, 0.0)
        mass = self.payload.mass_kg * float(np.exp(values.log_mass))
        if phases.loaded is not None and phases.held is not None:
            loaded, held, limb = phases.loaded, phases.held, phases.limb
            body = model.body(PAYLOAD + limb).id
            site = self._sites[limb]
            turn = quaternions.to_matrix(model.site_quat[site])
            centre = held[:3, :3] @ self.payload.centre + held[:3, 3] + values.centre
            model.body_ipos[body] = turn @ centre + model.site_pos[site]
            return lambda row: self._hang(limb, mass if loaded[row] else 0.0)
        if phases.sliding is not None:
            body = int(model.site_bodyid[self._sites[phases.limb]])
            weight = mass * float(np.linalg.norm(model.opt.gravity))
            up = -model.opt.gravity / np.linalg.norm(model.opt.gravity)

            def push(row: int) -> None:
                data.xfrc_applied[body] = 0.0
                if run.ways[row].any():
                    rubbing = values.mu * weight * (1.0 - values.lifted) * run.ways[row]
                    force = -(rubbing + values.lifted * weight * up + mass * run.rates[row])
                    data.xfrc_applied[body, :3] = force
                    data.xfrc_applied[body, 3:] = np.cross(run.points[row] - data.xipos[body], force)

            return push
        return lambda row: None

    def _hang(self, limb: str, mass: float) -> None:
        body = self.model.body(PAYLOAD + limb).id
        self.model.body_mass[body] = max(mass, 1e-9)
        self.model.body_inertia[body] = max(mass / self.payload.mass_kg * self.payload.inertia, 1e-12)


def _payload(bundle: TaskBundle) -> Payload:
    model = compile_folder(bundle.model)
    data = at_home(model)
    root = model.body(bundle.task.object).id
    frame = transforms.rigid(data.xmat[root].reshape(3, 3), data.xpos[root])
    mass, centre = float(model.body_subtreemass[root]), data.subtree_com[root].copy()
    bodies = np.flatnonzero(model.body_rootid == root)
    arms = np.linalg.norm(data.xipos[bodies] - centre, axis=1)
    inertia = float((model.body_inertia[bodies].mean(axis=1) + model.body_mass[bodies] * arms**2 * 2 / 3).sum())
    return Payload(mass, transforms.apply(transforms.invert(frame), centre[None])[0], inertia)


def _alone(bundle: TaskBundle) -> Any:
    """The compiled model of the robot without objects, joints of hands and contacts; each palm has an empty payload."""
    spec = machine.load(bundle.model)
    for name in bundle.objects:
        spec.delete(spec.body(name))
    arms = {ROBOT + joint.name for joint in bundle.robot.joints if joint.group == "arm"}
    parts = (spec.keys, spec.sensors, spec.tendons, spec.equalities, spec.pairs, spec.excludes)
    for part in [each for group in parts for each in list(group)]:
        spec.delete(part)
    for actuator in [each for each in spec.actuators if each.target not in arms]:
        spec.delete(actuator)
    for joint in [each for each in spec.joints if each.name not in arms]:
        spec.delete(joint)
    for name, limb in bundle.robot.limbs.items():
        if limb.palm:
            body = spec.site(ROBOT + bundle.robot.frames[limb.palm]).parent.add_body(name=PAYLOAD + name)
            body.explicitinertial, body.mass, body.inertia = True, 1e-9, [1e-12] * 3
            # Away from the frame of its body, or else MuJoCo compiles it so that it cannot be moved.
            body.ipos, body.iquat = [0.01, 0.01, 0.01], [0.8, 0.6, 0.0, 0.0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    try:
        return spec.compile()
    except ValueError as error:
        raise RuleError(
            "the arms of this robot cannot be simulated without their hands",
            code="DXB-B211",
            facts={"MuJoCo": error},
        ) from None
