"""Rendered RGB-D sequences with true poses: things on a table before textured walls, drawn by ray casting."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.artifacts.objects.object import Joint
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import cameras, kinematics, raycast, transforms
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.tracking.model import Model

CAMERA = Camera(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
RATE = 30.0
LIGHT = np.array([0.35, -0.5, -0.8]) / np.linalg.norm([0.35, -0.5, -0.8])
DEPTH = DepthNoise(smear=0.3, dark_loss=0.2, shine_loss=0.5)
Path = Callable[[float], np.ndarray]


@dataclass(frozen=True)
class Actor:
    """A thing of a sequence: its links, joints and path T_world_object (4, 4) over time [s]."""

    links: Mapping[str, Mesh]
    path: Path
    joints: tuple[Joint, ...] = ()
    positions: Callable[[float], np.ndarray] = field(default=lambda time: np.zeros(0))
    tracked: bool = True
    symmetric: bool = False

    def model(self) -> Model:
        """As a tracker knows it."""
        meshes = {name: (mesh.vertices, mesh.faces) for name, mesh in self.links.items()}
        return Model(meshes, self.joints)

    def posed(self, time: float) -> dict[str, np.ndarray]:
        """T_world_link (4, 4) of each link."""
        given = {joint.name: float(at) for joint, at in zip(self.joints, self.positions(time), strict=True)}
        found = kinematics.link_poses(self, given)
        return {name: self.path(time) @ pose for name, pose in found.items()}


@dataclass(frozen=True)
class Sequence:
    """What happens before a camera."""

    name: str
    actors: Mapping[str, Actor]
    camera: Path
    seconds: float
    rate: float = RATE
    lens: Camera = CAMERA


@dataclass(frozen=True)
class Strain:
    """What makes frames worse than those of a good camera."""

    rate: float | None = None
    """Frames per second instead of those of the sequence [Hz]."""
    noise: float = 1.0
    """Factor of the noise of depth and colour."""
    shift_px: int = 0
    """By how much the depth lies to the right of the colours [px]."""


def table() -> Mesh:
    """A wooden table top [m] in the plane z = 0 with a grain."""
    return plane(1.6, 1.2, wood(0), np.eye(4))


def plane(width: float, depth: float, texture: np.ndarray, pose: np.ndarray) -> Mesh:
    """A textured rectangle in the plane z = 0 of a pose."""
    from dextera_build.artifacts.cameras.image import Image

    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * [width / 2, depth / 2, 1]
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    uv = (np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32))[faces]
    vertices = transforms.apply(pose, corners).astype(np.float32)
    return Mesh(vertices=vertices, faces=faces, uv=uv, texture=Image(pixels=texture))


def wood(seed: int) -> np.ndarray:
    """Planks (512, 512, 3) uint8."""
    random = np.random.default_rng(seed)
    row, column = np.mgrid[0:512, 0:512]
    grain = np.sin(row / 3.0 + 4 * np.sin(column / 90.0) + random.normal(0, 0.6, (512, 1)))
    planks = (row // 128) * 14.0
    tone = 150 + 10 * grain + planks * 0.5 + random.normal(0, 4, (512, 512))
    return np.clip(tone[..., None] * [1.0, 0.8, 0.58], 0, 255).astype(np.uint8)


def posters(seed: int) -> np.ndarray:
    """Coloured rectangles on grey (512, 512, 3) uint8."""
    random = np.random.default_rng(seed)
    pixels = np.full((512, 512, 3), 175, np.uint8)
    for _ in range(60):
        left, top = random.integers(0, 480, 2)
        wide, high = random.integers(8, 70, 2)
        pixels[top : top + high, left : left + wide] = random.integers(30, 240, 3)
    return pixels


def surroundings() -> list[Mesh]:
    """A table before two walls."""
    back = np.eye(4)
    back[:3, :3], back[:3, 3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], (0, 1.1, 0.4)
    floor = np.eye(4)
    floor[2, 3] = -0.75
    return [table(), plane(4, 3, posters(1), back), plane(5, 5, posters(2) // 2, floor)]


def render(sequence: Sequence, time: float, scenery: list[Mesh]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faultless sRGB (H, W, 3) 0..1, depth (H, W) [m], and labels (H, W): number of the actor from 1, or 0."""
    surfaces, owners, poses = [], [], []
    for mesh in scenery:
        surfaces.append(_surface(mesh, np.eye(4)))
        owners.append(0)
    for number, actor in enumerate(sequence.actors.values(), 1):
        poses = actor.posed(time)
        for name, mesh in actor.links.items():
            surfaces.append(_surface(mesh, poses[name]))
            owners.append(number)
    camera = sequence.camera(time)
    lens = sequence.lens
    seen = raycast.render(surfaces, lens.matrix(), camera, lens.height, lens.width)
    colour = raycast.shade(surfaces, seen).astype(np.float64) / 255
    light = 0.55 + 0.45 * np.abs(seen.normal @ LIGHT)
    labels = np.append(np.array(owners), 0)[seen.index]
    return np.clip(colour * light[..., None], 0, 1), seen.depth, labels


def frames(
    sequence: Sequence, seed: int = 0, still: bool = False, strain: Strain | None = None
) -> Iterator[tuple[RgbdFrame, np.ndarray]]:
    """Frames as a depth camera measures them, and the true labels (H, W).

    Args:
        sequence: What happens.
        seed: Of the noise.
        still: Whether nothing moves, so that one render serves all frames.
        strain: What makes them worse.
    """
    strain = strain or Strain()
    rate = strain.rate or sequence.rate
    deeper = DEPTH.model_copy(update={"subpixel_px": DEPTH.subpixel_px * strain.noise})
    colours = ColourNoise(sigma=ColourNoise().sigma * strain.noise)
    scenery, drawn = surroundings(), None
    for number in range(round(sequence.seconds * rate)):
        time = number / rate
        random = np.random.default_rng((seed, number))
        drawn = render(sequence, time, scenery) if drawn is None or not still else drawn
        rgb, depth, labels = drawn
        measured = np.roll(measure_depth(depth, rgb, sequence.lens.matrix(), deeper, random), strain.shift_px, axis=1)
        yield RgbdFrame(time, measure_colour(_soft(rgb), colours, random), measured), labels


def _soft(rgb: np.ndarray) -> np.ndarray:
    import cv2

    return np.asarray(cv2.GaussianBlur(rgb, (3, 3), 0.7))


def _surface(mesh: Mesh, pose: np.ndarray) -> raycast.Surface:
    vertices = transforms.apply(pose, mesh.vertices.astype(np.float64))
    texture = None if mesh.texture is None else mesh.texture.pixels
    return raycast.Surface(vertices, mesh.faces, mesh.uv, texture, mesh.colour)


def standing(x: float, y: float, yaw_deg: float = 0.0, z: float = 0.0) -> np.ndarray:
    """T_world_object of a thing on the table."""
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return transforms.rigid(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([x, y, z]))


def before(distance: float = 0.75, pitch_deg: float = 40.0, heading_deg: float = 0.0) -> np.ndarray:
    """T_world_camera of a camera before the table."""
    return cameras.look_down(np.array([0.0, 0.0, 0.05]), distance, np.radians(heading_deg), np.radians(pitch_deg), 0.0)
