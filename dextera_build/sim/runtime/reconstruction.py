"""Transfer tracked poses at a reset to the twin (paper, cross-domain replay)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.geometry import lie, poses, quaternions, transforms
from dextera_build.policy.observation import Measurement
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment

STEP_M = 0.0005
"""Step by which penetrating objects are raised [m]."""
RAISE_M = 0.02
"""Maximum raise of an object [m]."""


@dataclass(frozen=True)
class Tracker:
    """Errors of an object tracker, standard deviations per axis; zero means perfect."""

    position_m: float = 0.0
    """Position error [m]."""
    rotation_rad: float = 0.0
    """Rotation error, as a rotation vector applied from the right [rad]."""


def reconstruct(seen: Measurement, ctrl: np.ndarray, twin: Environment, tracker: Tracker, seed: int) -> Start:
    """Reconstruct measurements of another world as a start in the twin, with the twin's own estimates of dynamics.

    Bodies and joints correspond in both worlds. Surfaces differ, so an object that would penetrate another or the
    table is raised out of contact.

    Args:
        seen: Joints and tracked objects, in the twin's order, poses in the base frame.
        ctrl: Joint targets (A,) of the robot at that time [rad].
        twin: Environment of the start.
        tracker: Errors added to the poses.
        seed: Seed of these errors and of the start.
    """
    bundle, model = twin.bundle, twin.model
    start = starts.photographed(bundle, model)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start.qpos, start.ctrl
    random = np.random.default_rng([seed, 2])
    for name, pose in zip(bundle.objects, seen.objects, strict=True):
        place = bundle.base_pose.matrix @ poses.to_matrix(pose) @ _error(tracker, random)
        data.joint(name).qpos[:3] = place[:3, 3]
        data.joint(name).qpos[3:] = quaternions.from_matrix(place[:3, :3])
    for name, position in zip(bundle.displacement_names, seen.displacement, strict=True):
        data.joint(name).qpos[0] = position
    measured = {joint.name: float(each) for joint, each in zip(bundle.robot.joints, seen.joints, strict=True)}
    for name, position in bundle.robot.followed(measured).items():
        data.joint(ROBOT + name).qpos[0] = position
    for number, joint in enumerate(bundle.robot.joints):
        data.actuator(ROBOT + joint.name).ctrl[0] = ctrl[number]
    _raise(model, data, list(bundle.objects))
    return start.model_copy(update={"seed": seed, "qpos": data.qpos.copy(), "ctrl": data.ctrl.copy()})


def _raise(model: Any, data: Any, names: list[str]) -> None:
    """Raise objects out of penetration; in a contact of two objects, the one with the higher origin."""
    roots = {int(model.body(name).id): name for name in names}
    for _ in range(round(RAISE_M / STEP_M)):
        mujoco.mj_forward(model, data)
        sunk = {_upper(model, data, roots, pair) for pair in data.contact.geom[data.contact.dist < -starts.TOUCH_M]}
        if not sunk - {""}:
            return
        for name in sorted(sunk - {""}):
            data.joint(name).qpos[2] += STEP_M


def _upper(model: Any, data: Any, roots: dict[int, str], pair: np.ndarray) -> str:
    """The object of a contact to raise; empty for self-contacts and contacts within the robot."""
    bodies = {int(model.body_rootid[model.geom_bodyid[geom]]) for geom in pair}
    free = sorted(bodies & roots.keys(), key=lambda body: float(data.xpos[body][2]))
    return roots[free[-1]] if free and len(bodies) > 1 else ""


def _error(tracker: Tracker, random: np.random.Generator) -> np.ndarray:
    turn = lie.rotation(random.standard_normal(3) * tracker.rotation_rad)
    return transforms.rigid(turn, random.standard_normal(3) * tracker.position_m)
