"""Views of foreign meshes on a table, as a noisy depth camera gives them, and the meshes as assets of unknown frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.objects.view import MeasuredView, ObjectView, Seen
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, raycast, registration, transforms
from dextera_build.testing import RuleRunner
from tests import factories
from tests.benchmarks import catalogue

LENS = Camera(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
SMALLEST, LARGEST = 0.04, 0.45
"""Range of the largest side of an object [m]."""
LEAST = 900
"""Fewest visible pixels of an object that counts as visible."""
MARGIN = 14
"""Border of the crop [px]."""


@dataclass(frozen=True)
class Known:
    """A view and its truth."""

    name: str
    seen: Seen
    asset: Body  # the true mesh, turned at random, of unknown unit
    scale: float  # metres per unit of the asset
    pose: np.ndarray  # (4, 4) T_world_object of the asset's frame
    visible: float  # fraction of the silhouette that nothing hides
    distance: float  # of the camera from the middle of the table [m]


@dataclass(frozen=True)
class Conditions:
    """How hard the views are."""

    nearest: float = 0.45  # distance of the camera [m]
    farthest: float = 1.0
    noise: float = 1.0  # times that of the camera's depth


def things(folder: Path, cache: Path) -> dict[str, tuple[Mesh, ...]]:
    """The parts of every mesh of the catalogue [m], each thing upright at the origin."""
    runner = RuleRunner(cache)
    found: Any = runner.run(
        "reference.catalogue", folder=Folder.of(folder), options={"entries": catalogue.entries(), "texture_px": 256}
    )
    made = {name: tuple(part.mesh for part in thing.parts.values()) for name, thing in found.items.items()}
    return {name: parts for name, parts in made.items() if SMALLEST < _size(parts) < LARGEST}


def draws(
    library: dict[str, tuple[Mesh, ...]], count: int, seed: int, how: Conditions | None = None
) -> Iterator[Known]:
    """`count` visible objects; every draw has its own random numbers."""
    names = sorted(library)
    order = np.random.default_rng(seed).permutation(len(names))
    made = 0
    for number in range(20 * count):
        random = np.random.default_rng([seed, number])
        # Every thing takes its turn.
        name = names[order[made % len(names)]]
        known = _draw(library, name, names[int(random.integers(len(names)))], random, how or Conditions())
        if known is not None:
            made += 1
            yield known
        if made == count:
            return


def _size(parts: tuple[Mesh, ...]) -> float:
    return float(np.ptp(np.concatenate([mesh.vertices for mesh in parts]), axis=0).max())


def _draw(
    library: dict[str, tuple[Mesh, ...]], name: str, other: str, random: np.random.Generator, how: Conditions
) -> Known | None:
    from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
    from dextera_build.sim.render import sensor

    corners = np.concatenate([mesh.vertices for mesh in library[name]]).astype(np.float64)
    pose = _standing(corners, random)
    away, height = random.uniform(how.nearest, how.farthest), np.radians(random.uniform(20.0, 65.0))
    eye = factories.look_at((0.0, -away * np.cos(height), away * np.sin(height)), (0.0, 0.0, 0.04))
    surfaces = [_surface(mesh, pose) for mesh in library[name]]
    parts, alone = len(surfaces), raycast.render(surfaces, LENS.matrix(), eye, 480, 640)
    if random.uniform() < 0.5:
        surfaces += _neighbour(library[other], corners, pose, random)
    surfaces.append(_table())
    shot = raycast.render(surfaces, LENS.matrix(), eye, 480, 640)
    mine = (shot.index >= 0) & (shot.index < parts)
    whole = alone.index >= 0
    border = whole.copy()
    border[2:-2, 2:-2] = False
    visible = float(mine.sum() / max(int(whole.sum()), 1))
    if mine.sum() < LEAST or visible < 0.25 or border.any():
        return None
    rgb = raycast.shade(surfaces, shot) / 255.0
    facing = np.abs((shot.normal * np.array([0.3, -0.5, 0.8])).sum(axis=-1))
    rgb = np.clip(rgb * (0.45 + 0.55 * facing)[..., None], 0.0, 1.0)
    noise = DepthNoise(subpixel_px=0.05 * how.noise, edge_loss=0.5, smear=0.5, dark_loss=0.4, shine_loss=0.8)
    depth = sensor.measure_depth(shot.depth, rgb, LENS.matrix(), noise, random)
    colour = sensor.measure_colour(rgb, ColourNoise(), random)
    nearer = (shot.depth > 0) & (shot.index >= parts) & (shot.index < len(surfaces) - 1)
    seen = cropped((colour, depth), ragged(mine, random), nearer & whole, eye, LENS)
    turn = registration.spread_rotations(5000)[int(random.integers(5000))]
    scale = float(10.0 ** random.uniform(-1.0, 1.0))
    shift = random.normal(0.0, 0.1, 3)
    # x_world = pose x_thing = pose (turn^T (x_asset * scale) - shift)
    asset = _asset(library[name], turn, shift, scale)
    true = pose @ transforms.rigid(turn.T, -shift)
    return Known(name, seen, asset, scale, true, visible, away)


def _standing(corners: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """T_world_thing: upright in half of the draws, otherwise on a face of its hull on which it is stable."""
    turn = np.eye(3)
    if random.uniform() < 0.5:
        hull = ConvexHull(corners)
        middle = corners[hull.vertices].mean(axis=0)
        good = [k for k in range(len(hull.simplices)) if _stable(corners[hull.simplices[k]], hull.equations[k], middle)]
        if good:
            turn = transforms.rotation_between(hull.equations[int(random.choice(good)), :3], np.array([0.0, 0.0, -1.0]))
    turn = lie.rotation(np.array([0.0, 0.0, random.uniform(0.0, 2.0 * np.pi)])) @ turn
    placed = corners @ turn.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    at = np.array([*random.normal(0.0, 0.03, 2), 0.0]) - np.array([*((low + high) / 2.0)[:2], low[2]])
    return transforms.rigid(turn, at)


def _stable(corners: np.ndarray, plane: np.ndarray, middle: np.ndarray) -> bool:
    """Whether the middle is over the triangle."""
    foot = middle - (plane[:3] @ middle + plane[3]) * plane[:3]
    sides = np.cross(np.roll(corners, -1, axis=0) - corners, foot - corners) @ plane[:3]
    return bool((sides > 0).all() or (sides < 0).all())


def _neighbour(
    parts: tuple[Mesh, ...], corners: np.ndarray, pose: np.ndarray, random: np.random.Generator
) -> list[raycast.Surface]:
    """Another thing upright in front of the first, on the side of the camera."""
    mine = transforms.apply(pose, corners)[:, :2]
    theirs = np.concatenate([mesh.vertices for mesh in parts])[:, :2].astype(np.float64)
    gap = np.abs(mine).max() + np.linalg.norm(theirs, axis=1).max() * 0.9
    angle = -np.pi / 2.0 + random.uniform(-0.9, 0.9)
    at = transforms.rigid(
        lie.rotation(np.array([0.0, 0.0, random.uniform(0.0, 6.28)])),
        np.array([gap * np.cos(angle), gap * np.sin(angle), 0.0]),
    )
    return [_surface(mesh, at) for mesh in parts]


def _surface(mesh: Mesh, pose: np.ndarray) -> raycast.Surface:
    texture = None if mesh.texture is None else mesh.texture.pixels
    return raycast.Surface(
        transforms.apply(pose, mesh.vertices.astype(np.float64)), mesh.faces, mesh.uv, texture, mesh.colour
    )


def _table() -> raycast.Surface:
    flat = np.array([[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]])
    return raycast.Surface(flat, np.array([[0, 1, 2], [0, 2, 3]]), colour=(0.5, 0.42, 0.33))


def ragged(mask: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The mask with a border that is off by about a pixel, alike over some ten pixels: no segmentation is exact."""
    off = ndimage.gaussian_filter(random.standard_normal(mask.shape), 5.0)
    off *= 1.0 / off.std()
    inside = ndimage.distance_transform_edt(mask) - ndimage.distance_transform_edt(~mask)
    return np.asarray(inside - np.sign(inside) * 0.5 + off > 0.0)


def cropped(
    shot: tuple[np.ndarray, np.ndarray], mask: np.ndarray, nearer: np.ndarray, eye: np.ndarray, lens: Camera
) -> Seen:
    """Colour and depth of a whole picture, cut out around the mask, with `nearer` as occluder."""
    rgb, depth = shot
    mask &= ~nearer
    rows, columns = np.nonzero(mask)
    top, left = max(0, rows.min() - MARGIN), max(0, columns.min() - MARGIN)
    bottom, right = min(lens.height, rows.max() + MARGIN + 1), min(lens.width, columns.max() + MARGIN + 1)
    cut = (slice(top, bottom), slice(left, right))
    part = lens.model_copy(
        update={"width": int(right - left), "height": int(bottom - top), "cx": lens.cx - left, "cy": lens.cy - top}
    )
    view = ObjectView(
        rgb=Image(pixels=np.ascontiguousarray(rgb[cut])),
        mask=np.ascontiguousarray(mask[cut]),
        occluder=np.ascontiguousarray(nearer[cut]),
        camera=part,
        phrase="thing",
    )
    measured = MeasuredView(
        depth=DepthImage(depth=np.ascontiguousarray(depth[cut])),
        camera_pose=Pose(parent="world", child="camera", matrix=eye),
    )
    return Seen(view, measured)


def _asset(parts: tuple[Mesh, ...], turn: np.ndarray, shift: np.ndarray, scale: float) -> Body:
    """The thing as one link: x_asset = turn (x_thing + shift) / scale, with the texture of its largest part."""
    vertices, faces, base = [], [], 0
    for mesh in parts:
        vertices.append((mesh.vertices.astype(np.float64) + shift) @ turn.T / scale)
        faces.append(mesh.faces + base)
        base += len(mesh.vertices)
    whole = {"vertices": np.concatenate(vertices).astype(np.float32), "faces": np.concatenate(faces)}
    made = parts[0].model_copy(update=whole) if len(parts) == 1 else Mesh(**whole, colour=parts[0].colour)
    return Body(links={"base": Link(mesh=made)})
