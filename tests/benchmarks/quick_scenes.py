"""Drawn scenes by ray casting, without the engine: cheaper than those of the recipes, for what is learned from many.

Things of `household` stand or lie, apart or touching, on one another and in vessels. One lamp casts shadows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.artifacts.scenes.world import Lamp
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, raycast, regions, transforms
from rules.reference.drawn import surroundings
from rules.reference.drawn.places import apart
from tests.benchmarks import household

GAP_M = 0.0005
"""Gap between things that touch [m]."""


@dataclass(frozen=True)
class Shot:
    """A faultless photograph with its truth."""

    rgb: np.ndarray  # (H, W, 3) float64 sRGB 0..1
    depth: np.ndarray  # (H, W) image-plane z [m], 0 if empty
    labels: np.ndarray  # (H, W) int32, 0 for fixtures
    camera: Camera
    support: Support


@dataclass
class _Placed:
    parts: tuple[Mesh, ...]
    outline: np.ndarray  # (k, 2)
    level: float | None  # height of a top on which something can stand
    word: str


def scene(rng: np.random.Generator, half: np.ndarray) -> list[tuple[Mesh, ...]]:
    """The parts of every thing on the table z = 0 of half the size `half` (2,) [m]."""
    return [parts for _, parts in named_scene(rng, half)]


def named_scene(
    rng: np.random.Generator,
    half: np.ndarray,
    draw: Callable[[np.random.Generator], household.Piece] = household.draw,
) -> list[tuple[str, tuple[Mesh, ...]]]:
    """Word and parts of every thing, as of `scene`; `draw` chooses the things."""
    placed: list[_Placed] = []
    gap = GAP_M if rng.uniform() < 0.6 else 0.02
    for _ in range(int(rng.integers(3, 10))):
        thing = draw(rng)
        kind = rng.uniform()
        below = [other for other in placed if other.level is not None]
        if kind < 0.2 and below:
            _stack(thing, below[int(rng.integers(len(below)))], placed, rng)
            continue
        found = _stand(thing, placed, half, gap, rng)
        if found is not None and thing.inside is not None and rng.uniform() < 0.45:
            _fill(thing, found, placed, rng)
    return [(one.word, one.parts) for one in placed]


def _stand(
    thing: household.Piece, placed: list[_Placed], half: np.ndarray, gap: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Put a thing on the table; its pose, or None if it found no place or lies on its side."""
    lying = rng.uniform() < (0.12 if thing.inside is not None else 0.3)
    turn = about(2, rng.uniform(0, 2 * np.pi)) @ (about(0, np.pi / 2) if lying else np.eye(3))
    corners = np.concatenate([part.vertices for part in thing.parts]) @ turn.T
    outline = regions.convex_hull(corners[:, :2].astype(np.float64))
    low, top = float(corners[:, 2].min()), float(np.ptp(corners[:, 2]))
    for _ in range(30):
        spot = rng.normal(0.0, 0.16, 2)
        if placed and gap == GAP_M:
            spot = _slid(outline, placed, gap, rng)
        moved = outline + spot
        inside = (np.abs(moved) < half - 0.03).all()
        if inside and all(apart(moved, other.outline, gap) for other in placed):
            pose = transforms.rigid(turn, np.array([*spot, -low]))
            level = top if lying and thing.top is not None and thing.inside is None else thing.top
            flat = level is not None and not (lying and _round(thing))
            placed.append(_Placed(thing.moved(pose), moved, level if flat else None, thing.word))
            return None if lying else pose
    return None


def _slid(outline: np.ndarray, placed: list[_Placed], gap: float, rng: np.random.Generator) -> np.ndarray:
    """A place next to one of the things, as near as the outlines allow."""
    anchor = placed[int(rng.integers(len(placed)))].outline.mean(axis=0)
    angle = rng.uniform(0, 2 * np.pi)
    ahead = np.array([np.cos(angle), np.sin(angle)])
    for distance in np.arange(0.02, 0.5, 0.004):
        if all(apart(outline + anchor + distance * ahead, other.outline, gap) for other in placed):
            return np.asarray(anchor + distance * ahead)
    return np.asarray(anchor)


def _stack(thing: household.Piece, below: _Placed, placed: list[_Placed], rng: np.random.Generator) -> None:
    """Put a thing on another one whose middle carries it."""
    turn = about(2, rng.uniform(0, 2 * np.pi))
    middle, half = below.outline.mean(axis=0), np.ptp(below.outline, axis=0) / 2
    spot = middle + rng.uniform(-0.3, 0.3, 2) * half
    corners = np.concatenate([part.vertices for part in thing.parts]) @ turn.T
    outline = regions.convex_hull(corners[:, :2].astype(np.float64)) + spot
    if np.ptp(outline, axis=0).max() > 2.2 * np.ptp(below.outline, axis=0).max():
        return
    others = [other for other in placed if other is not below]
    if not all(apart(outline, other.outline, GAP_M) for other in others):
        return
    assert below.level is not None
    pose = transforms.rigid(turn, np.array([*spot, below.level]))
    level = None if thing.top is None else below.level + thing.top
    below.level = None
    placed.append(_Placed(thing.moved(pose), outline, level, thing.word))


def _fill(vessel: household.Piece, pose: np.ndarray, placed: list[_Placed], rng: np.random.Generator) -> None:
    """Lay one to three small things into a vessel."""
    assert vessel.inside is not None
    x, y, floor = vessel.inside
    own: list[np.ndarray] = []
    for _ in range(int(rng.integers(1, 4))):
        thing = household.small(rng)
        turn = pose[:3, :3] @ about(2, rng.uniform(0, 2 * np.pi))
        corners = np.concatenate([part.vertices for part in thing.parts]) @ turn.T
        outline = regions.convex_hull(corners[:, :2].astype(np.float64))
        room = np.array([x, y]) - np.ptp(outline, axis=0) / 2
        if (room < -0.004).any():
            continue
        at = rng.uniform(-1, 1, 2) * np.maximum(room, 0.0) - (outline.max(axis=0) + outline.min(axis=0)) / 2
        spot = pose[:2, 3] + (pose[:2, :2] @ at if abs(x - y) > 1e-6 else at)
        moved = outline + spot
        if all(apart(moved, other, GAP_M) for other in own):
            own.append(moved)
            place = transforms.rigid(turn, np.array([*spot, pose[2, 3] + floor + 0.0005]))
            placed.append(_Placed(thing.moved(place), moved, None, thing.word))


def _round(thing: household.Piece) -> bool:
    return len(thing.parts[0].vertices) > 200


def about(axis: int, angle: float) -> np.ndarray:
    """The rotation (3, 3) about an axis by an angle [rad]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix())


@dataclass(frozen=True)
class Room:
    """A table with its surroundings, without things; it is dear to draw."""

    surfaces: tuple[raycast.Surface, ...]
    lamps: tuple[Lamp, ...]
    ambient: float
    half: np.ndarray  # (2,) half the size of the table [m]


def room(rng: np.random.Generator) -> Room:
    """A random room; the table's middle is the origin."""
    drawn = surroundings.table(rng)
    surfaces = tuple(
        surface(piece.mesh, fixture.pose.matrix)
        for fixture in surroundings.fixtures(drawn, rng).values()
        for piece in fixture.parts.values()
    )
    lamps, ambient = surroundings.light(rng)
    return Room(surfaces, lamps, ambient, np.array(drawn.size_m[:2]) / 2)


def photograph(things: list[tuple[Mesh, ...]], around: Room, rng: np.random.Generator) -> Shot:
    """One photograph of the things from a random place in front of the table."""
    surfaces = [surface(part) for parts in things for part in parts] + list(around.surfaces)
    owners = [label for label, parts in enumerate(things, start=1) for _ in parts] + [0] * len(around.surfaces)
    points = np.concatenate([part.vertices for parts in things for part in parts])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    heading, pitch, roll = np.radians(rng.uniform([-45, 25, -5], [45, 75, 5]))
    pose = cameras.look_down(middle, float(rng.uniform(0.5, 1.1)), float(heading), float(pitch), float(roll))
    camera = Camera(width=640, height=480, fx=614.4, fy=614.4, cx=319.5, cy=239.5)
    rgb, depth, labels = shoot(surfaces, np.array(owners), around.lamps, around.ambient, camera, pose)
    at = Pose(parent="world", child="camera", matrix=pose)
    polygon = around.half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return Shot(rgb, depth, labels, camera, Support(camera_pose=at, polygon=polygon))


def shoot(
    surfaces: list[raycast.Surface],
    owners: np.ndarray,
    lamps: tuple[Lamp, ...],
    ambient: float,
    camera: Camera,
    pose: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours (H, W, 3) sRGB 0..1, image-plane depth [m] and owner of every pixel, without noise."""
    from scipy import ndimage

    seen = raycast.render(surfaces, camera.matrix(), pose, camera.height, camera.width)
    rays = cameras.rays(camera.height, camera.width, camera.matrix()) @ pose[:3, :3].T
    facing = np.where(((seen.normal * rays).sum(axis=-1) > 0)[..., None], -seen.normal, seen.normal)
    light = np.full(seen.depth.shape, ambient)
    prepared = raycast.RayScene(*((one.vertices, one.faces) for one in surfaces))
    for lamp in lamps:
        towards = -np.array(lamp.direction) / np.linalg.norm(lamp.direction)
        share = np.clip(facing @ towards, 0.0, 1.0)
        if lamp.shadow:
            start = pose[:3, 3] + rays * seen.depth[..., None] + 1e-3 * facing
            ways = np.concatenate([start, np.broadcast_to(towards, start.shape)], axis=-1)
            share = share * (1.0 - ndimage.uniform_filter(prepared.occluded(ways, 5.0).astype(float), 5))
        light = light + 1.3 * lamp.strength * share
    rgb = np.clip(raycast.shade(surfaces, seen) / 255.0 * light[..., None], 0.0, 1.0)
    # The lens blurs by half a pixel.
    return ndimage.gaussian_filter(rgb, (0.5, 0.5, 0.0)), seen.depth, np.append(owners, 0)[seen.index].astype(np.int32)


def surface(mesh: Mesh, pose: np.ndarray | None = None) -> raycast.Surface:
    """A mesh to draw, moved by a pose (4, 4)."""
    vertices = mesh.vertices.astype(np.float64)
    texture = None if mesh.texture is None else mesh.texture.pixels
    return raycast.Surface(
        vertices if pose is None else transforms.apply(pose, vertices), mesh.faces, mesh.uv, texture, mesh.colour
    )


def sensor(rng: np.random.Generator) -> DepthNoise:
    """A depth camera drawn at random."""
    return DepthNoise(
        subpixel_px=0.05 * 2 ** rng.uniform(-1.5, 1.5),
        correlation_px=int(rng.integers(1, 6)),
        edge_px=int(rng.integers(1, 4)),
        edge_loss=rng.uniform(0.1, 0.95),
        smear=rng.uniform(0.0, 1.0),
        dark_loss=rng.uniform(0.0, 0.7),
        shine_loss=rng.uniform(0.0, 0.8),
        step_m=float(rng.choice([0.0001, 0.001, 0.002])),
        dropout=float(rng.choice([0.002, 0.05])),
    )
