"""Eight kinds of jointed objects, drawn by seed: links as solids, joints, and a position of every joint.

Object frame: z up as it stands on z = 0; links are at joint position 0, which is closed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dextera_build.artifacts.objects.object import Joint
from dextera_build.geometry import kinematics, solids, transforms
from dextera_build.geometry.solids import Solid


@dataclass(frozen=True)
class Thing:
    """A jointed object with its truth; has what `geometry.kinematics` needs of a body."""

    links: dict[str, Solid]
    joints: tuple[Joint, ...]
    flat: bool = False
    """Whether it lies on the table and is best seen from above."""

    def at(self, positions: dict[str, float]) -> Thing:
        """The same thing with its joints at other positions [rad or m]."""
        moved = (
            joint.model_copy(update={"position": positions.get(joint.name, joint.position)}) for joint in self.joints
        )
        return replace(self, joints=tuple(moved))

    def posed(self) -> dict[str, Solid]:
        """Link -> solid in the object frame at the joints' positions, standing on z = 0."""
        poses = kinematics.link_poses(self)
        return {name: solid.moved(poses[name]) for name, solid in self.links.items()}

    def collides(self) -> bool:
        """Whether a hundredth of a link is inside another one: temples of glasses cannot pass through each other."""
        for one, other in combinations(self.posed().values(), 2):
            if solids.intersection(one, other).volume > 0.01 * min(one.volume, other.volume):
                return True
        return False

    def drawn(self, draw: np.random.Generator) -> Thing:
        """The same thing with every joint at a drawn position between 20 % and 80 % of its range."""
        return self.at({j.name: float(j.lower + draw.uniform(0.2, 0.8) * (j.upper - j.lower)) for j in self.joints})


def joint(name: str, kind: str, child: str, origin, axis, upper: float, parent: str = "base") -> Joint:
    """A joint that is closed at 0."""
    x, y, z = (float(value) for value in origin)
    a, b, c = (float(value) for value in axis)
    return Joint(
        name=name, type=kind, parent=parent, child=child, origin=(x, y, z), axis=(a, b, c), lower=0.0, upper=upper,
        position=0.0,
    )  # fmt: skip


def laptop(draw: np.random.Generator) -> Thing:
    """Two slabs; opens by up to 135 degrees about its back edge."""
    width, depth = draw.uniform(0.28, 0.38), draw.uniform(0.19, 0.26)
    base, lid = draw.uniform(0.012, 0.02), draw.uniform(0.005, 0.009)
    back = depth / 2 - 0.004
    links = {
        "base": solids.box((width, depth, base), (0.0, 0.0, base / 2)),
        "lid": solids.box((width, depth - 0.004, lid), (0.0, -0.002, base + lid / 2)),
    }
    return Thing(links, (joint("hinge", "revolute", "lid", (0, back, base), (-1, 0, 0), np.radians(135)),))


def lidded(draw: np.random.Generator) -> Thing:
    """A box with a lid hinged at its back edge."""
    size = draw.uniform((0.15, 0.12, 0.07), (0.3, 0.22, 0.14))
    wall, lid = draw.uniform(0.004, 0.008), draw.uniform(0.005, 0.01)
    base = open_box(size, wall)
    links = {"base": base, "lid": solids.box((size[0], size[1], lid), (0.0, 0.0, size[2] + lid / 2))}
    axis = joint("hinge", "revolute", "lid", (0, size[1] / 2, size[2]), (-1, 0, 0), np.radians(115))
    return Thing(links, (axis,))


def cupboard(draw: np.random.Generator) -> Thing:
    """A cupboard with one door in front of it, hinged on the left or the right."""
    width, depth, height = draw.uniform((0.22, 0.18, 0.28), (0.36, 0.28, 0.45))
    wall, door = draw.uniform(0.01, 0.018), draw.uniform(0.01, 0.018)
    side = draw.choice([-1.0, 1.0])
    case = open_box((width, height, depth), wall).moved(
        transforms.rigid(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float), np.array([0, depth / 2, height / 2]))
    )
    shelf = solids.box((width - wall, depth - 0.02, wall), (0, 0.009, height * draw.uniform(0.4, 0.6)))
    links = {
        "base": solids.union([case, shelf]),
        "door": solids.box((width, door, height), (0, -depth / 2 - door / 2, height / 2)),
    }
    axis = joint("hinge", "revolute", "door", (side * width / 2, -depth / 2, 0), (0, 0, side), np.radians(110))
    return Thing(links, (axis,))


def drawers(draw: np.random.Generator) -> Thing:
    """A cabinet with two or three drawers, one above another."""
    width, depth, height = draw.uniform((0.24, 0.2, 0.18), (0.36, 0.3, 0.32))
    wall, count = draw.uniform(0.008, 0.014), int(draw.integers(2, 4))
    rows = (height - wall) / count
    links = {"base": solids.box((width, depth, height), (0, 0, height / 2))}
    joints = []
    for number in range(count):
        low = wall + number * rows
        hole = (width - 2 * wall, depth - wall, rows - wall)
        middle = (0.0, -wall / 2, low + hole[2] / 2)
        links["base"] = solids.difference(links["base"], solids.box((hole[0], hole[1] + 0.01, hole[2]), middle))
        inner = (hole[0] - 0.004, hole[1] - 0.01, 0.75 * hole[2])
        tray = open_box(inner, 0.005).moved(transforms.rigid(np.eye(3), np.array([0, -wall / 2 + 0.004, low + 0.003])))
        face = solids.box((width - 0.004, 0.012, rows - 0.004), (0, -depth / 2 - 0.006, low - wall / 2 + rows / 2))
        name = f"drawer_{number}"
        links[name] = solids.union(
            [tray, face, solids.box((0.08, 0.015, 0.01), (0, -depth / 2 - 0.018, low + hole[2] / 2))]
        )
        joints.append(joint(f"slide_{number}", "prismatic", name, (0, 0, low), (0, -1, 0), 0.75 * depth))
    return Thing(links, tuple(joints))


def scissors(draw: np.random.Generator) -> Thing:
    """Two blades with rings, one upon the other, on a pin."""
    length, thick = draw.uniform(0.15, 0.22), draw.uniform(0.003, 0.005)
    ahead, wide = 0.55 * length, draw.uniform(0.012, 0.018)
    half = []
    for side, low in ((1.0, 0.0), (-1.0, thick)):
        blade = np.array(
            [[0, -wide / 2], [ahead, -side * wide / 2], [ahead * 0.9, side * wide / 2 * 0.2], [0, wide / 2]]
        )
        grip = np.array(
            [
                [0, -wide / 2],
                [0, wide / 2],
                [-0.25 * length, wide / 2 - side * 0.02],
                [-0.25 * length, -wide / 2 - side * 0.02],
            ]
        )
        ring = np.array([-0.32 * length, -side * 0.027, 0.0])
        outer, inner = solids.ring(0.03, 0.021, 2.0, 0.0, 40), solids.ring(0.02, 0.012, 2.0, 0.0, 40)
        parts = [counter(blade), counter(grip)]
        solid = [solids.extrude(outline, low, low + thick) for outline in parts]
        hoop = solids.extrude_rings([(outer + ring)[:, :2], (inner + ring)[:, :2]], low, low + thick)
        half.append(solids.union([*solid, hoop]))
    axis = joint("pin", "revolute", "other", (0, 0, 0), (0, 0, -1), np.radians(70))
    return Thing({"base": half[0], "other": half[1]}, (axis,), flat=True)


def pliers(draw: np.random.Generator) -> Thing:
    """Short jaws and long bent handles on a thick pin."""
    length, thick = draw.uniform(0.15, 0.2), draw.uniform(0.008, 0.012)
    wide = draw.uniform(0.012, 0.016)
    half = []
    for side, low in ((1.0, 0.0), (-1.0, thick / 2)):
        jaw = np.array(
            [
                [0, -wide / 2],
                [0, wide / 2],
                [0.3 * length, side * 0.002 + wide / 4 * (side + 1) / 2],
                [0.3 * length, side * 0.002 + wide / 4 * (side - 1) / 2],
            ]
        )
        handle = np.array(
            [
                [0.0, wide / 2],
                [0.0, -wide / 2],
                [-0.25 * length, -side * 0.018 - 0.006],
                [-0.7 * length, -side * 0.022 - 0.006],
                [-0.7 * length, -side * 0.022 + 0.006],
                [-0.25 * length, -side * 0.018 + 0.006],
            ]
        )
        disc = solids.ring(wide * 0.8, wide * 0.8, 2.0, 0.0, 32)[:, :2]
        flat = [solids.extrude(disc, low, low + thick / 2)]
        full = [solids.extrude(counter(hull(outline)), 0.0, thick) for outline in (jaw[2:],) if len(outline) > 2]
        arms = [solids.extrude(counter(outline), low, low + thick / 2) for outline in (jaw, handle)]
        half.append(solids.union([*flat, *arms, *full]))
    axis = joint("pin", "revolute", "other", (0, 0, 0), (0, 0, -1), np.radians(50))
    return Thing({"base": half[0], "other": half[1]}, (axis,), flat=True)


def sunglasses(draw: np.random.Generator) -> Thing:
    """A front with two temples, upside down on the table."""
    width, height = draw.uniform(0.13, 0.15), draw.uniform(0.038, 0.05)
    long, thick = draw.uniform(0.12, 0.14), draw.uniform(0.004, 0.006)
    rim = solids.box((width, thick, 0.012), (0, 0, 0.006))
    lenses = [solids.box((0.4 * width, thick * 0.6, height), (s * 0.26 * width, 0, height / 2)) for s in (-1, 1)]
    links = {"base": solids.union([rim, *lenses])}
    joints = []
    for name, side in (("left", -1.0), ("right", 1.0)):
        # Folded, a temple lies behind the front; it opens backwards.
        lift = 0.0 if side < 0 else thick + 0.001
        middle = (side * (width / 2 - long / 2), thick / 2 + thick / 2 + lift + 0.001, 0.006)
        links[name] = solids.box((long, thick, 0.012), middle)
        origin = (side * (width / 2 - 0.002), thick / 2 + 0.001 + lift, 0)
        joints.append(joint(f"{name}_hinge", "revolute", name, origin, (0, 0, -side), np.radians(95)))
    return Thing(links, tuple(joints), flat=True)


def stapler(draw: np.random.Generator) -> Thing:
    """A base and an arm that is hinged at its back end."""
    long, wide = draw.uniform(0.12, 0.17), draw.uniform(0.026, 0.038)
    base, arm = draw.uniform(0.01, 0.015), draw.uniform(0.018, 0.026)
    foot = solids.box((long, wide, base), (0, 0, base / 2))
    top = solids.box((long * 0.97, wide * 0.8, arm), (0.005, 0, base + 0.003 + arm / 2))
    axis = joint("hinge", "revolute", "arm", (-long / 2 + 0.01, 0, base + 0.003), (0, -1, 0), np.radians(60))
    return Thing({"base": foot, "arm": top}, (axis,))


def open_box(size, wall: float) -> Solid:
    """A box on z = 0 without a top."""
    x, y, z = size
    inner = solids.box((x - 2 * wall, y - 2 * wall, z), (0, 0, z / 2 + wall))
    return solids.difference(solids.box((x, y, z), (0, 0, z / 2)), inner)


def counter(outline: np.ndarray) -> np.ndarray:
    """A polygon (P, 2), counter-clockwise."""
    x, y = outline.T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    return outline if area > 0 else outline[::-1]


def hull(outline: np.ndarray) -> np.ndarray:
    """The convex hull of points (P, 2)."""
    from scipy.spatial import ConvexHull

    return outline[ConvexHull(outline).vertices]


KINDS: dict[str, Callable[[np.random.Generator], Thing]] = {
    "laptop": laptop,
    "box_with_lid": lidded,
    "cupboard": cupboard,
    "drawers": drawers,
    "scissors": scissors,
    "pliers": pliers,
    "sunglasses": sunglasses,
    "stapler": stapler,
}
