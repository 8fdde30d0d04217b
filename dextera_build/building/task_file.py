"""The text of a recipe that proposes tasks for the objects of a twin, for people to edit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.code.companions import in_folder, names_in
from dextera_build.code.loader import Library
from dextera_build.geometry import cavities, kinematics, transforms
from dextera_build.sim.model import task_places
from dextera_build.sim.primitives.proposals import Proposal, Shape

FILE = "proposals"
"""File of a primitive with its proposals, which is optional and in no key."""
SHOWN = "shown"
"""Target of one demonstration of each task, and the end of the names of their nodes."""
_HEAD = """\
summary: Tasks for the objects of {twin}, proposed by `dxb new task`.
inputs:
  scene: {twin}:scene
  assets: {twin}:body.asset
  support: {twin}:ground
  robot: {robot}
nodes:
  # guess: robot behind the objects, facing the camera; if it is calibrated, use `measured` instead.
"""
_BASE = (
    "  {name}: {{rule: align.base, support: $support, position_m: [{x:.2f}, {y:.2f}, {z:.2f}], yaw_deg: {yaw:.0f}}}\n"
)


@dataclass(frozen=True)
class Task:
    """A task that is proposed for an object."""

    object: str
    """Label of its asset."""
    primitive: str
    """As `simulate.task` calls it."""
    proposal: Proposal
    """Its name and the options of its goal."""


def holds(robot: RobotModel) -> bool:
    """Whether a limb of the robot can hold an object; others push."""
    return any(
        limb.gripper is not None or any(grip.against != "nothing" for grip in limb.grips.values())
        for limb in robot.limbs.values()
    )


def tasks(library: Library, assets: Mapping[str, Asset]) -> list[Task]:
    """Tasks for the objects that primitives propose, in their `proposals.py`.

    Args:
        library: Has the primitives of the project.
        assets: Label -> object.
    """
    shapes = {label: _shape(asset) for label, asset in sorted(assets.items())}
    files = {name: in_folder(library, f"primitives/{name}", FILE) for name in names_in(library, "primitives", FILE)}
    return [
        Task(label, name, proposal)
        for label in shapes
        for name, file in files.items()
        if file.file.is_file()
        for proposal in file.module.proposals(label, shapes)
    ]


def has_arm(robot: RobotModel) -> bool:
    """Whether the robot has an arm, which takes its hand to an object."""
    return any(limb.arm for limb in robot.limbs.values())


def text(
    twin: str, robot: str, assets: Mapping[str, Asset], found: Sequence[Task], model: RobotModel | None = None
) -> str:
    """The file.

    Args:
        twin: Address of the twin's recipe.
        robot: Address of the robot's recipe.
        assets: Label -> object of the twin.
        found: The tasks.
        model: The robot, for where it is put; None: at a distance that fits an arm of a person's size.
    """
    used = {task.object for task in found}
    spots = {label: asset.pose.matrix[:3, 3] for label, asset in assets.items() if label in used}
    places = task_places.found(model, spots)
    bases = {f"base_{place.objects[0]}" if place.objects else "base": place for place in places}
    head = _HEAD.format(twin=twin, robot=robot)
    for name, place in bases.items():
        x, y, z = (round(each, 2) + 0.0 for each in place.at_m)
        head += _BASE.format(name=name, x=x, y=y, z=z, yaw=place.yaw_deg)
    lines = [line for task in found for line in _node(task, "base" if "base" in bases else f"base_{task.object}")]
    names = [node(task) for task in found]
    end = f"targets:\n  default: [{', '.join(names)}]\n  {SHOWN}: [{', '.join(map(shown, names))}]\n"
    return head + "\n".join(lines) + "\n" + end


def node(task: Task) -> str:
    """Name of the node of a task."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in task.proposal.name).strip("_")


def shown(name: str) -> str:
    """Node that demonstrates once the task of node `name`."""
    return f"{name}_{SHOWN}"


def _node(task: Task, base: str) -> Iterator[str]:
    name, own, options = task.proposal.name, node(task), task.proposal.options
    yield f"  {own}:"
    yield "    rule: simulate.task"
    yield from (f"    {slot}: ${slot}" for slot in ("scene", "assets", "robot"))
    yield f"    base: ${base}"
    yield f"    name: {name}"
    yield f"    primitive: {task.primitive}"
    yield f"    object: {task.object}"
    yield f"    {task.primitive}: {{{', '.join(f'{option}: {value}' for option, value in options.items())}}}"
    yield "    reset: {position_m: 0.03, yaw_deg: 15}"
    yield f"  {shown(own)}: {{rule: demonstrate.operate, bundle: ${own}, episodes: 1, good: 2}}"


def _shape(asset: Asset) -> Shape:
    joints = {joint.name: (joint.position, joint.lower, joint.upper) for joint in asset.body.joints}
    return Shape(joints, _extent(asset), _room(asset))


def _extent(asset: Asset) -> np.ndarray:
    """Extents (3,) in the world's axes [m]."""
    vertices, _ = kinematics.posed_surface(asset.body)
    return np.asarray(np.ptp(transforms.apply(asset.pose.matrix, vertices.astype(np.float64)), axis=0))


def _room(asset: Asset) -> np.ndarray | None:
    """Extents (3,) of its cavity [m]; None if nothing stays in it."""
    found = cavities.find(*kinematics.posed_surface(asset.body))
    if found is None:
        return None
    _, cell, floor, rim = found
    deep = rim - floor
    cells = np.argwhere(deep > 0.5 * deep.max())
    return np.array([*((np.ptp(cells, axis=0) + 1) * cell), float(deep.max())])
