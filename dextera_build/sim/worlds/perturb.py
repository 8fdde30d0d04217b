"""Perturb geometry and physics of a twin's task, as the other world if no reference world exists.

Every object gets a different size, mass, centre of mass, friction, contact stiffness and hinge friction; the robot gets
different gains, friction, clock and delay. Names, frames, joints and their order are unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle, TaskObject
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import quaternions
from dextera_build.sim.model import machine, matter
from dextera_build.sim.model.model import at_home, compile_folder

Factors = tuple[float, float, float]
"""Scale factors along x, y, z of the object's frame."""
FARTHEST = 2.0
"""Normal draws are clipped at this many standard deviations."""
SLIPPERY = 0.05
"""Minimum friction coefficient."""


@dataclass(frozen=True)
class Disturbance:
    """Magnitude of the perturbation of objects."""

    size_sigma: float
    """Standard deviation of the logarithm of each scale factor."""
    dynamics: float
    """Fraction of the twin's own intervals of mass and friction to draw from."""
    hinge_sigma: float
    """Standard deviation of the logarithm of the factor on a hinge's friction."""
    centre_m: float
    """Standard deviation of each coordinate of the centre of mass [m]."""
    contact_sigma: float
    """Standard deviation of the logarithm of the factor on the contacts' natural frequency."""


@dataclass(frozen=True)
class Drawn:
    """The perturbation of one object."""

    sizes: np.ndarray
    """Scale factors (3,) along the object's axes."""
    mass: float
    """Factor on the mass."""
    friction: float
    """Sliding friction coefficient."""
    rate: float
    """Factor on the natural frequency of contacts."""
    hinge: float
    """Factor on the friction of joints."""
    centre: np.ndarray
    """Shift (3,) of the centre of mass [m]."""


def build(
    bundle: TaskBundle, most: Disturbance, robot: machine.Machine, sizes: Mapping[str, Factors]
) -> tuple[TaskBundle, dict[str, Factors]]:
    """Build the perturbed task; also return the scale factors of every object.

    Args:
        bundle: The task in the twin.
        most: Magnitude of the objects' perturbation.
        robot: Perturbation of robot and clock; its seed is used for everything.
        sizes: Body -> scale factors that override drawn ones.

    Raises:
        RuleError: `sizes` names an unknown object, or stretches one with joints.
    """
    if unknown := sorted(set(sizes) - set(bundle.objects)):
        raise RuleError(
            f"the task has no object `{unknown[0]}`",
            code="DXB-B244",
            facts={"objects": listing(bundle.objects, most=20)},
        )
    spec = machine.load(bundle.model)
    model = compile_folder(bundle.model)
    home = at_home(model)
    positions = {model.joint(number).name: home.joint(number).qpos.copy() for number in range(model.njnt)}
    objects, used = {}, {}
    for number, (name, thing) in enumerate(bundle.objects.items()):
        random = np.random.default_rng([robot.seed, number])
        used[name] = _sizes(random, spec, name, thing, most, sizes.get(name))
        drawn = _draw(thing, used[name], most, random)
        objects[name] = _disturb(spec, name, thing, drawn, positions)
    machine.disturb(spec, bundle.robot, robot)
    changed = machine.finish(spec, positions, home, bundle.model.files)
    update = {"model": changed, "objects": objects, "kind": "perturbed", "latency_s": robot.latency_s}
    return bundle.model_copy(update=update), used


def stretch(inertia: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of a body of the same mass, stretched by `factors` (3,) along its axes."""
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    second = np.diag(factors) @ second @ np.diag(factors)
    return np.asarray(np.trace(second) * np.eye(3) - second)


def _sizes(
    random: np.random.Generator, spec: Any, name: str, thing: TaskObject, most: Disturbance, given: Factors | None
) -> Factors:
    drawn = np.exp(most.size_sigma * _normal(random, 3))
    even = bool(thing.joints) or not _is_straight(spec.body(name))
    if given is not None:
        if even and len(set(given)) > 1:
            raise RuleError(
                f"`{name}` has joints, so it can be scaled only evenly",
                code="DXB-B246",
                facts={"factors": given},
                hint=f"give three equal factors, or leave `{name}` out of `sizes`",
            )
        return given
    if even:
        drawn[:] = drawn[0]
    return float(drawn[0]), float(drawn[1]), float(drawn[2])


def _is_straight(body: Any) -> bool:
    """Whether all geoms are meshes or boxes aligned with the body's axes, and can be stretched along them."""
    kinds = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_BOX)
    return all(geom.type in kinds and abs(abs(geom.quat[0]) - 1.0) < 1e-9 for geom in body.geoms)


def _draw(thing: TaskObject, sizes: Factors, most: Disturbance, random: np.random.Generator) -> Drawn:
    low, high = (1.0 + most.dynamics * (end - 1.0) for end in thing.mass_scale)
    mass = float(random.uniform(low, high))
    friction, rate, hinge, *centre = _normal(random, 6)
    return Drawn(
        sizes=np.array(sizes),
        mass=mass,
        friction=max(SLIPPERY, thing.friction + most.dynamics * thing.friction_sigma * float(friction)),
        rate=float(np.exp(most.contact_sigma * rate)),
        # Hinges are designed for their load: a heavier lid has a stiffer one.
        hinge=float(np.exp(most.hinge_sigma * hinge)) * mass * sizes[0],
        centre=most.centre_m * np.array(centre),
    )


def _disturb(spec: Any, name: str, thing: TaskObject, drawn: Drawn, positions: dict[str, np.ndarray]) -> TaskObject:
    root = spec.body(name)
    for body in (root, *root.find_all("body")):
        if body.name != name:
            body.pos = np.asarray(body.pos) * drawn.sizes
        _heavier(body, drawn.mass, drawn.sizes)
        for geom in body.geoms:
            _resize(spec, geom, drawn.sizes)
            geom.friction[0] = drawn.friction
            if geom.solref[0] > 0.0:
                geom.solref[0] /= drawn.rate
    root.ipos = np.asarray(root.ipos) + drawn.centre
    moved = tuple(
        _loosen(spec.joint(joint), position, float(drawn.sizes[0]), drawn.hinge, positions)
        for joint, position in zip(thing.joints, thing.positions, strict=True)
    )
    still = {"mass_scale": (1.0, 1.0), "friction": drawn.friction, "friction_sigma": 0.0, "scale_sigma": None}
    return thing.model_copy(update={**still, "positions": moved})


def _loosen(joint: Any, position: float, size: float, friction: float, positions: dict[str, np.ndarray]) -> float:
    """Scale a joint's position and friction, and a slider's travel; return its value in the photograph."""
    joint.pos = np.asarray(joint.pos) * size
    joint.frictionloss *= friction
    joint.damping = np.asarray(joint.damping) * friction
    if joint.type != mujoco.mjtJoint.mjJNT_SLIDE:
        return position
    joint.range = np.asarray(joint.range) * size
    positions[joint.name] = positions[joint.name] * size
    return position * size


def _heavier(body: Any, mass: float, sizes: np.ndarray) -> None:
    turn = quaternions.to_matrix(np.asarray(body.iquat))
    inertia = turn @ np.diag(body.inertia) @ turn.T
    centre = np.asarray(body.ipos) * sizes
    matter.put(body, float(body.mass) * mass, centre, mass * stretch(inertia, sizes))


def _resize(spec: Any, geom: Any, sizes: np.ndarray) -> None:
    geom.pos = np.asarray(geom.pos) * sizes
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = spec.mesh(geom.meshname)
        mesh.scale = np.asarray(mesh.scale) * sizes
    else:
        geom.size = np.asarray(geom.size) * sizes


def _normal(random: np.random.Generator, count: int) -> np.ndarray:
    return np.clip(random.standard_normal(count), -FARTHEST, FARTHEST)
