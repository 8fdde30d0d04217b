"""Hand-made artifacts with known truth: a box, a bowl with exact walls, a laptop with a hinge, a bare table."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import (
    Asset,
    Body,
    Collision,
    Inertial,
    Joint,
    Link,
    Physics,
    Pieces,
    Support,
)
from dextera_build.artifacts.scenes.scene import Background, SupportBox
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.geometry import cameras, transforms

BOX_FACES = np.array(
    [
        *([0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6]),  # bottom, top
        *([0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7]),  # front, back
        *([0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]),  # left, right
    ],
    np.int32,
)
"""Triangles of `box_corners`, counter-clockwise seen from outside."""


def camera(width: int = 320, height: int = 240) -> Camera:
    """A camera whose principal point is not the middle."""
    return Camera(width=width, height=height, fx=0.95 * width, fy=0.95 * width, cx=0.49 * width, cy=0.52 * height)


def look_at(place: tuple[float, float, float], target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """T_world_camera (4, 4) of an OpenCV camera at `place` [m] that looks at `target` [m], image right horizontal."""
    return cameras.look_at(np.array(place), np.array(target))


def support(half: float = 0.5) -> Support:
    """A square table of edge 2 `half` [m], seen from the front and above."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64) * half
    return Support(
        camera_pose=placed(look_at((0.0, -0.9, 0.7)), "camera"), polygon=corners, residual_m=0.001, inlier_fraction=0.8
    )


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """T_world_object (4, 4): turned by `yaw` [rad] about z, then moved [m]."""
    c, s = np.cos(yaw), np.sin(yaw)
    return transforms.rigid(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, z]))


def placed(matrix: np.ndarray, child: str = "object", parent: str = "world") -> Pose:
    """T_parent_child."""
    return Pose(parent=parent, child=child, matrix=matrix)


def box_corners(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """Corners (8, 3) float32; bit 0 of the row is x, bit 1 is y, bit 2 is z."""
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    return np.where(bits, high, low).astype(np.float32)


def box_mesh(
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    colour: tuple[float, float, float] = (0.8, 0.3, 0.2),
) -> Mesh:
    """A closed box between two corners [m]."""
    return Mesh(vertices=box_corners(low, high), faces=BOX_FACES, colour=colour)


def textured(mesh: Mesh, pixels: np.ndarray) -> Mesh:
    """`mesh` with the lower left half of `pixels` on every triangle."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.float32)
    return Mesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        uv=np.tile(corners, (len(mesh.faces), 1, 1)),
        texture=Image(pixels=pixels),
    )


def box_inertial(low: tuple[float, float, float], high: tuple[float, float, float], mass: float) -> Inertial:
    """Mass properties of a solid, even box."""
    x, y, z = np.subtract(high, low)
    middle = np.add(low, high) / 2
    moments = mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    return Inertial(
        mass_kg=mass,
        mass_low_kg=0.7 * mass,
        mass_high_kg=1.4 * mass,
        centre=(float(middle[0]), float(middle[1]), float(middle[2])),
        inertia=(float(moments[0]), float(moments[1]), float(moments[2]), 0.0, 0.0, 0.0),
        source="hand-made: even box",
    )


def physics(
    links: dict[str, Inertial], *, friction: float = 0.5, restitution: float = 0.1, material: str = "plastic"
) -> Physics:
    """Contact properties with a set friction."""
    return Physics(links=links, friction=friction, friction_sigma=0.1, restitution=restitution, material=material)


def box_asset(
    place: np.ndarray | None = None,
    size: tuple[float, float, float] = (0.06, 0.16, 0.21),
    mass: float = 0.4,
    *,
    friction: float = 0.5,
    restitution: float = 0.1,
) -> Asset:
    """A textured box of `size` [m], object frame at the middle of its base, at `place` (T_world_object)."""
    low, high = (-size[0] / 2, -size[1] / 2, 0.0), (size[0] / 2, size[1] / 2, size[2])
    rows, columns = np.indices((32, 32))
    stripes = np.stack([rows * 8, columns * 8, np.full_like(rows, 90)], axis=-1).astype(np.uint8)
    mesh = textured(box_mesh(low, high), stripes)
    hull = Hull(vertices=mesh.vertices)
    where = pose() if place is None else place
    return Asset(
        body=Body(links={"base": Link(mesh=mesh)}, pose=placed(where)),
        physics=physics({"base": box_inertial(low, high, mass)}, friction=friction, restitution=restitution),
        collision=Collision(links={"base": Pieces(hulls=(hull,), method="hull")}),
        pose=placed(where),
        category="box",
    )


def bowl_asset(place: np.ndarray | None = None, radius: float = 0.08, height: float = 0.06, mass: float = 0.3) -> Asset:
    """A bowl open upwards: 16 wall slabs and a floor, 5 mm thick; a ball dropped into it must stay inside."""
    thick, count = 0.005, 16
    where = pose() if place is None else place
    angles = np.arange(count) * 2 * np.pi / count
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    base = 0.6 * radius
    rings = [ring * base, ring * radius + up * height, ring * (radius - thick) + up * height]
    rings.append(ring * (base - thick) + up * thick)
    walls = []
    for i in range(count):
        j = (i + 1) % count
        walls.append(Hull(vertices=np.array([r[k] for r in rings for k in (i, j)], np.float32)))
    floor = np.concatenate([ring * base, ring * base + up * thick]).astype(np.float32)
    walls.append(Hull(vertices=floor))
    mesh = Mesh(vertices=_with_poles(rings, thick), faces=_revolved_faces(count, len(rings)), colour=(0.5, 0.5, 0.52))
    moment = 0.5 * mass * (0.8 * radius) ** 2
    inertial = Inertial(
        mass_kg=mass,
        mass_low_kg=0.7 * mass,
        mass_high_kg=1.4 * mass,
        centre=(0.0, 0.0, 0.4 * height),
        inertia=(0.7 * moment, 0.7 * moment, moment, 0.0, 0.0, 0.0),
        source="hand-made: ring",
    )
    return Asset(
        body=Body(links={"base": Link(mesh=mesh, walls=tuple(walls))}, pose=placed(where), hollow=True),
        physics=physics({"base": inertial}, material="ceramic"),
        collision=Collision(links={"base": Pieces(hulls=tuple(walls), method="walls", cavity_fill=0.0)}),
        pose=placed(where),
        category="bowl",
    )


def laptop_asset(place: np.ndarray | None = None, opening: float = 1.9, mass: float = 1.3) -> Asset:
    """A laptop: base slab and lid slab, hinge along x at the back edge, closed at 0, seen at `opening` [rad]."""
    where = pose() if place is None else place
    base = ((-0.16, -0.11, 0.0), (0.16, 0.11, 0.016))
    lid = ((-0.16, -0.11, 0.0165), (0.16, 0.11, 0.0225))
    joint = Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="lid",
        origin=(0.0, 0.11, 0.0165),
        axis=(-1.0, 0.0, 0.0),
        lower=0.0,
        upper=2.3,
        position=opening,
    )
    links = {
        "base": Link(mesh=box_mesh(*base, colour=(0.6, 0.6, 0.62))),
        "lid": Link(mesh=box_mesh(*lid, colour=(0.25, 0.25, 0.3))),
    }
    hulls = {name: Pieces(hulls=(Hull(vertices=link.mesh.vertices),), method="hull") for name, link in links.items()}
    return Asset(
        body=Body(links=links, joints=(joint,), pose=placed(where)),
        physics=physics({"base": box_inertial(*base, 0.7 * mass), "lid": box_inertial(*lid, 0.3 * mass)}),
        collision=Collision(links=hulls),
        pose=placed(where),
        category="laptop",
    )


def background(half: float = 0.5, size: tuple[int, int] = (240, 320)) -> Background:
    """A bare table top: two triangles with a gradient, and its box."""
    rows, columns = np.indices(size)
    pixels = np.stack([150 + columns * 60 // size[1], 120 + rows * 60 // size[0], np.full(size, 90)], axis=-1)
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]], np.float32)
    uv = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], np.float32)
    image = Image(pixels=pixels.astype(np.uint8))
    mesh = Mesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32), uv=uv, texture=image)
    box = SupportBox(name="support", centre=(0.0, 0.0, -0.025), half_size=(half + 0.05, half + 0.05, 0.025))
    return Background(image=image, depth=DepthImage(depth=np.ones(size, np.float32)), mesh=mesh, boxes=(box,))


def capture(lens: Camera | None = None, table: Support | None = None) -> Capture:
    """What the camera of `support()` sees of the bare table: even colour, exact depth, 0 above the horizon."""
    lens, table = lens or camera(), table or support()
    directions = cameras.rays(lens.height, lens.width, lens.matrix()) @ table.camera_pose.matrix[:3, :3].T
    down = directions[..., 2]
    depth = np.where(down < -1e-6, table.camera_pose.matrix[2, 3] / np.maximum(-down, 1e-6), 0.0)
    depth = np.where(depth < 5.0, depth, 0.0).astype(np.float32)
    pixels = np.full((lens.height, lens.width, 3), (168, 140, 110), np.uint8)
    return rgbd(pixels, depth, lens)


def rgbd(pixels: np.ndarray, depth: np.ndarray, lens: Camera) -> Capture:
    """A capture of (H, W, 3) uint8 and (H, W) float32 [m]."""
    return Capture(
        photograph=Photograph(rgb=Image(pixels=pixels), camera=lens), measured=Measured(depth=DepthImage(depth=depth))
    )


def shot(capture: Capture) -> dict[str, Artifact]:
    """The inputs `photograph` and `measured` of a rule."""
    found: dict[str, Artifact | None] = {"photograph": capture.photograph, "measured": capture.measured}
    return {name: part for name, part in found.items() if part is not None}


def _with_poles(rings: list[np.ndarray], thick: float) -> np.ndarray:
    poles = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, thick]])
    return np.concatenate([*rings, poles]).astype(np.float32)


def _revolved_faces(count: int, rings: int) -> np.ndarray:
    """Faces of stacked rings (outside base -> rim -> inside) closed by a pole at the first and at the last ring."""
    faces = []
    bottom, inner = count * rings, count * rings + 1
    for i in range(count):
        j = (i + 1) % count
        faces.append([bottom, j, i])
        for ring in range(rings - 1):
            a, b = ring * count, (ring + 1) * count
            faces += [[a + i, a + j, b + j], [a + i, b + j, b + i]]
        last = (rings - 1) * count
        faces.append([inner, last + i, last + j])
    return np.array(faces, np.int32)


def gaussians(count: int, coefficients: int = 16, seed: int = 0) -> Gaussians:
    """Gaussians of some centimetres within a metre, with colours that depend on the direction."""
    random = np.random.default_rng(seed)
    turns = random.normal(size=(count, 4))
    return Gaussians(
        random.normal(size=(count, 3)) * 0.3,
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        np.exp(random.normal(size=(count, 3)) * 0.5 - 3),
        random.uniform(0.05, 1, count),
        random.normal(size=(count, coefficients, 3)) * 0.3,
    )


def splats(count: int, coefficients: int = 16, frame: str = "object") -> Splats:
    """The same as an artifact."""
    return Splats.of(gaussians(count, coefficients), frame)
