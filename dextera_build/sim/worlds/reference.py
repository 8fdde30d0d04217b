"""A task in a reference world: the twin's model with its contents replaced by the ground truth.

Names, frames, joints and their order are the twin's, so states, actions and success have the same meaning. An asset's
body becomes the true object, but keeps the asset's frame at photo time, which moves with the object as if the asset
were tracked. The robot's base aligns both worlds; errors of the twin about the table or the robot displace objects of
the reference world, as on hardware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.scenes.world import Hinge, Matter, Part, Thing, World
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import lie, poses, quaternions, transforms
from dextera_build.sim.model import machine, matter, names
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.worlds import tracked

LEVEL_M = 0.002
"""Maximum distance of the top of a reference world's support from z = 0 [m]."""


@dataclass(frozen=True)
class Placed:
    """A true object and its pose in the twin."""

    body: str
    thing: Thing
    matter: Matter
    pose: np.ndarray
    """T_twin_thing, (4, 4)."""


@dataclass(frozen=True)
class Joined:
    """An object's hinge in the compiled model."""

    name: str
    """Name of the joint."""
    position: float
    """Position in the photograph [rad]."""


def build(
    bundle: TaskBundle, world: World, robot: machine.Machine, *, contact_rate: float, farthest_m: float
) -> TaskBundle:
    """Build the task in the reference world.

    Args:
        bundle: The task in the twin.
        world: The ground truth.
        robot: Differences of robot and clock from the twin's.
        contact_rate: Natural frequency of contacts [rad/s].
        farthest_m: See `tracked.match`.

    Raises:
        RuleError: An asset has no true object, or their hinges differ.
    """
    return _Builder(bundle, world, robot, contact_rate).build(farthest_m)


class _Builder:
    """Converts a twin's spec to the reference world's, step by step."""

    def __init__(self, bundle: TaskBundle, world: World, robot: machine.Machine, contact_rate: float) -> None:
        self.bundle, self.world, self.robot = bundle, world, robot
        self.frame = tracked.twin_from_truth(bundle, world)
        self.model = compile_folder(bundle.model)
        self.home = at_home(self.model)
        self.spec = machine.load(bundle.model)
        self.stock = matter.Stock(self.spec, contact_rate)
        self.positions = {
            self.model.joint(number).name: self.home.joint(number).qpos.copy() for number in range(self.model.njnt)
        }

    def build(self, farthest_m: float) -> TaskBundle:
        bundle, spec = self.bundle, self.spec
        pairs = tracked.match(bundle, self.world.objects, self.frame, farthest_m)
        dropped = self._clear()
        self._surroundings()
        objects = {}
        for body, name in pairs.items():
            placed = self._placed(body, self.world.objects[name])
            joined = self._exchange(placed)
            objects[body] = bundle.objects[body].model_copy(
                update={
                    "positions": tuple(joint.position for joint in joined),
                    "mass_scale": (1.0, 1.0),
                    "friction": placed.matter.friction,
                    "friction_sigma": 0.0,
                }
            )
        for name, thing in self.world.objects.items():
            if name not in pairs.values():
                self._extra(name, thing)
        machine.disturb(spec, bundle.robot, self.robot)
        kept = {name: data for name, data in bundle.model.files.items() if name not in dropped}
        model = machine.finish(spec, self.positions, self.home, {**kept, **self.stock.files})
        return bundle.model_copy(
            update={"model": model, "objects": objects, "kind": "reference", "latency_s": self.robot.latency_s}
        )

    def _clear(self) -> set[str]:
        """Remove the twin's geometry, but not its bodies, joints and robot; return its files."""
        spec = self.spec
        roots = [self.spec.body(name) for name in self.bundle.objects]
        bodies = [spec.worldbody, *roots, *(below for root in roots for below in root.find_all("body"))]
        for pair in list(spec.pairs):
            spec.delete(pair)
        for body in bodies:
            for geom in list(body.geoms):
                spec.delete(geom)
        for light in list(spec.lights):
            if not light.name.startswith(ROBOT):
                spec.delete(light)
        return machine.drop_unused(spec)

    def _surroundings(self) -> None:
        world, spec = self.world, self.spec
        spec.visual.headlight.ambient[:] = world.ambient
        spec.visual.headlight.diffuse[:] = 0.0
        spec.visual.headlight.specular[:] = 0.0
        for number, lamp in enumerate(world.lamps):
            direction = self.frame.matrix[:3, :3] @ (np.array(lamp.direction) / np.linalg.norm(lamp.direction))
            spec.worldbody.add_light(
                name=f"lamp_{number}",
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                pos=-3.0 * direction,
                dir=direction,
                diffuse=[lamp.strength] * 3,
                specular=[0.5 * lamp.strength] * 3,
                castshadow=lamp.shadow,
            )
        support = _support(world)
        for name, fixture in world.fixtures.items():
            pose = (self.frame @ fixture.pose).matrix
            for part_name, part in fixture.parts.items():
                own = names.plain(f"{name}_{part_name}" if len(fixture.parts) > 1 else name)
                self.stock.look(spec.worldbody, f"static_{own}_look", part, pose)
                for number, piece in enumerate(part.pieces):
                    label = "support" if name == support and number == 0 else f"{own}_{number}"
                    self.stock.touch(spec.worldbody, f"static_{label}", piece, pose, None)

    def _placed(self, body: str, thing: Thing) -> Placed:
        if thing.matter is None:
            raise RuleError(
                f"`{body}` is a thing without mass in the reference world",
                code="DXB-B242",
                hint="build the world with this version of `reference.world`",
            )
        return Placed(body, thing, thing.matter, (self.frame @ thing.pose).matrix)

    def _exchange(self, placed: Placed) -> list[Joined]:
        """Replace the asset's body by the true object, with the twin's frame in the photograph."""
        joints = self.bundle.objects[placed.body].joints
        root, hinge = self.spec.body(placed.body), placed.thing.hinge
        if not joints:
            self._fill(root, placed, placed.thing.parts, placed.matter.mass_kg, self._pose(placed.body))
            return []
        turns = self.spec.joint(joints[0]).type == mujoco.mjtJoint.mjJNT_HINGE
        if hinge is None or len(joints) > 1 or not turns:
            raise RuleError(
                f"the joints of `{placed.body}` in the twin are not those of its thing in the reference world",
                code="DXB-B243",
                facts={"twin": listing(joints), "thing": "no hinge" if hinge is None else "one hinge"},
                hint="a reference world supports objects with at most one hinge; correct the asset's joints",
            )
        joint = self.spec.joint(joints[0])
        moving = {name: placed.thing.parts[name] for name in hinge.parts}
        fixed = {name: part for name, part in placed.thing.parts.items() if name not in moving}
        child = self.model.body(int(self.model.joint(joints[0]).bodyid[0])).name
        self._fill(root, placed, fixed, placed.matter.mass_kg - hinge.mass_kg, self._pose(placed.body))
        self._fill(self.spec.body(child), placed, moving, hinge.mass_kg, self._pose(child))
        return [self._hang(joint, self.spec.body(child), hinge, placed)]

    def _hang(self, joint: Any, child: Any, hinge: Hinge, placed: Placed) -> Joined:
        """Place the true hinge at the twin's joint; the child keeps the twin's frame in the photograph."""
        link = self._pose(child.name)
        inside = transforms.invert(link) @ placed.pose
        axis = inside[:3, :3] @ (np.array(hinge.axis) / np.linalg.norm(hinge.axis))
        # A twin's joint that opens the other way keeps its sign; 0 is closed in both.
        sign = 1.0 if float(axis @ self.model.joint(joint.name).axis) >= 0.0 else -1.0
        origin = transforms.apply(inside, np.array(hinge.origin))
        position = sign * hinge.position
        opened = lie.turned(sign * axis, origin, position)
        parent = self._pose(self.model.body(int(self.model.body(child.name).parentid[0])).name)
        closed = transforms.invert(parent) @ link @ transforms.invert(opened)
        child.pos, child.quat = closed[:3, 3], quaternions.from_matrix(closed[:3, :3])
        joint.type = mujoco.mjtJoint.mjJNT_HINGE
        joint.pos, joint.axis = origin, sign * axis
        joint.range = sorted((sign * hinge.lower, sign * hinge.upper))
        joint.frictionloss = hinge.friction_nm
        joint.damping = [hinge.damping_nms_rad, 0.0, 0.0]
        self.positions[joint.name] = np.array([position])
        return Joined(joint.name, position)

    def _fill(self, body: Any, placed: Placed, parts: dict[str, Part], mass_kg: float, link: np.ndarray) -> None:
        pose = transforms.invert(link) @ placed.pose
        matter.weigh(body, list(parts.values()), mass_kg, pose)
        number = 0
        for name, part in parts.items():
            self.stock.look(body, f"{body.name}_{names.plain(name)}_look", part, pose)
            for piece in part.pieces:
                self.stock.touch(body, f"{body.name}_collision_{number}", piece, pose, placed.matter)
                number += 1

    def _extra(self, name: str, thing: Thing) -> None:
        """Append an object without an asset in the twin, with its hinge held."""
        taken = {body.name for body in self.spec.bodies}
        own = names.plain(name)
        while own in taken:
            own += "_too"
        placed = self._placed(own, thing)
        body = self.spec.worldbody.add_body(
            name=own, pos=placed.pose[:3, 3], quat=quaternions.from_matrix(placed.pose[:3, :3])
        )
        body.add_freejoint(name=own)
        self._fill(body, placed, thing.parts, placed.matter.mass_kg, placed.pose)
        self.positions[own] = poses.from_matrix(placed.pose)

    def _pose(self, body: str) -> np.ndarray:
        """T_twin_body in the photograph."""
        seen = self.home.body(body)
        return transforms.rigid(seen.xmat.reshape(3, 3).copy(), seen.xpos.copy())


def _support(world: World) -> str:
    """The fixture under the objects: its top is level with z = 0 and below the first object."""
    places = [thing.pose.matrix[:2, 3] for thing in world.objects.values()]
    for name, fixture in world.fixtures.items():
        points = transforms.apply(fixture.pose.matrix, fixture.surface.vertices.astype(np.float64))
        low, high = points.min(axis=0), points.max(axis=0)
        under = all((low[:2] <= place).all() and (place <= high[:2]).all() for place in places)
        if under and abs(float(high[2])) < LEVEL_M:
            return name
    return ""
