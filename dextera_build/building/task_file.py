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
from dextera_build.sim.primitives.proposals import Proposal, Shape

BEHIND_M = 0.55
"""How far behind the objects the robot is put at first [m]."""

FILE = "proposals"
"""File of a primitive with its proposals, which is optional and in no key."""
_HEAD = """\
summary: Tasks for the objects of {twin}, proposed by `dxb new task`.
inputs:
  scene: {twin}:scene
  assets: {twin}:body.asset
  support: {twin}:ground
  robot: {robot}
nodes:
  # guess: robot behind the objects, facing the camera; if it is calibrated, use `measured` instead.
  base: {{rule: align.base, support: $support, position_m: [{x:.2f}, {y:.2f}, 0.0], yaw_deg: 270}}
"""


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


def text(twin: str, robot: str, assets: Mapping[str, Asset], found: Sequence[Task]) -> str:
    """The file.

    Args:
        twin: Address of the twin's recipe.
        robot: Address of the robot's recipe.
        assets: Label -> object of the twin.
        found: The tasks.
    """
    places = np.array([asset.pose.matrix[:3, 3] for asset in assets.values()])
    x, y = float(places[:, 0].mean()), float(places[:, 1].max()) + BEHIND_M
    lines = [line for task in found for line in _node(task)]
    names = ", ".join(_snake(task.proposal.name) for task in found)
    end = f"targets:\n  default: [{names}]\n"
    return _HEAD.format(twin=twin, robot=robot, x=x, y=y) + "\n".join(lines) + "\n" + end


def _node(task: Task) -> Iterator[str]:
    name, options = task.proposal.name, task.proposal.options
    yield f"  {_snake(name)}:"
    yield "    rule: simulate.task"
    yield from (f"    {slot}: ${slot}" for slot in ("scene", "assets", "robot", "base"))
    yield f"    name: {name}"
    yield f"    primitive: {task.primitive}"
    yield f"    object: {task.object}"
    yield f"    {task.primitive}: {{{', '.join(f'{option}: {value}' for option, value in options.items())}}}"
    yield "    reset: {position_m: 0.03, yaw_deg: 15}"


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


def _snake(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).removeprefix("_")
