"""The text of a recipe that proposes tasks for the objects of a twin, for people to edit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from dextera_build.artifacts.object import Asset
from dextera_build.geometry import cavities, kinematics, transforms

BEHIND_M = 0.55
"""How far behind the objects the robot is put at first [m]."""
FLAT = 1.5
"""Ratio of height and width below which an object is pushed without tipping over."""

_HEAD = """\
summary: Tasks for the objects of {twin}, proposed by `dxb new task`.
inputs:
  scene: {twin}:scene
  assets: {twin}:body.asset
  support: {twin}:ground
  robot: {robot}
nodes:
  # guess: the robot stands behind the objects and looks at the camera; with a calibration, give `measured`.
  base: {{rule: align.base, support: $support, position_m: [{x:.2f}, {y:.2f}, 0.0], yaw_deg: 270}}
"""


@dataclass(frozen=True)
class Proposal:
    """A task that an object allows."""

    name: str
    """`PlaceMugInBasket`."""
    object: str
    """Label of its asset."""
    primitive: str
    """As `simulate.task` calls it."""
    goal: Mapping[str, str] = field(default_factory=dict)
    """Options of the goal, as YAML."""


def proposals(assets: Mapping[str, Asset]) -> list[Proposal]:
    """Tasks for the objects: joints are moved, what is flat is pushed, the rest is lifted or put into a container.

    Args:
        assets: Label -> object.
    """
    found = []
    boxes = {label: _extent(asset) for label, asset in assets.items()}
    rooms = {label: room for label, asset in assets.items() if (room := _room(asset)) is not None}
    for label, asset in sorted(assets.items()):
        if asset.body.joints:
            found += [
                _moved(label, joint.name, joint.position, joint.lower, joint.upper) for joint in asset.body.joints
            ]
            continue
        found.append(Proposal(f"Lift{_camel(label)}", label, "lift", {"height_m": "0.10"}))
        wide, high = float(np.min(boxes[label][:2])), float(boxes[label][2])
        if high < FLAT * wide:
            found.append(Proposal(f"Push{_camel(label)}", label, "push", {"by_m": "[0.10, 0.0]"}))
        for container, room in sorted(rooms.items()):
            if container != label and (np.sort(boxes[label])[::-1] < np.sort(room)[::-1]).all():
                name = f"Place{_camel(label)}In{_camel(container)}"
                found.append(Proposal(name, label, "pick_and_place", {"into": container}))
    return found


def text(twin: str, robot: str, assets: Mapping[str, Asset]) -> str:
    """The file.

    Args:
        twin: Address of the twin's recipe.
        robot: Address of the robot's recipe.
        assets: Label -> object of the twin.
    """
    places = np.array([asset.pose.matrix[:3, 3] for asset in assets.values()])
    x, y = float(places[:, 0].mean()), float(places[:, 1].max()) + BEHIND_M
    found = proposals(assets)
    lines = [line for proposal in found for line in _node(proposal)]
    names = ", ".join(_snake(proposal.name) for proposal in found)
    end = f"targets:\n  default: [{names}]\n"
    return _HEAD.format(twin=twin, robot=robot, x=x, y=y) + "\n".join(lines) + "\n" + end


def _node(proposal: Proposal) -> Iterator[str]:
    yield f"  {_snake(proposal.name)}:"
    yield "    rule: simulate.task"
    yield from (f"    {slot}: ${slot}" for slot in ("scene", "assets", "robot", "base"))
    yield f"    name: {proposal.name}"
    yield f"    primitive: {proposal.primitive}"
    yield f"    object: {proposal.object}"
    yield from (f"    {option}: {value}" for option, value in proposal.goal.items())
    yield "    reset: {position_m: 0.03, yaw_deg: 15}"


def _moved(label: str, joint: str, position: float, lower: float, upper: float) -> Proposal:
    """The joint goes to its farther limit; the lower one counts as closed."""
    closes = position - lower > upper - position
    target = np.degrees(lower if closes else upper)
    verb = "Close" if closes else "Open"
    return Proposal(f"{verb}{_camel(label)}", label, "articulate", {"joints_deg": f"{{{joint}: {target:.0f}}}"})


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


def _camel(label: str) -> str:
    return "".join(part.capitalize() for part in label.split("_"))


def _snake(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).removeprefix("_")
