"""Photographs of simple things on a table with known labels, rendered without noise or with that of a depth camera."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import cameras, planes, raycast, transforms
from tests import factories

LENS = Camera(width=320, height=240, fx=290.0, fy=291.0, cx=158.0, cy=121.5)
FINE = Camera(width=640, height=480, fx=580.0, fy=582.0, cx=316.0, cy=243.0)
"""For what depends on many pixels; four times as dear."""
EYE = factories.look_at((0.0, -0.65, 0.55))


@dataclass(frozen=True)
class Tabletop:
    """A capture with what is true of it."""

    capture: Capture
    labels: LabelImage
    """1 is the first thing."""
    world_from_camera: np.ndarray
    """T_world_camera, the table is z = 0."""


def tabletop(
    *things: tuple[Mesh, np.ndarray],
    eye: np.ndarray = EYE,
    half: float = 0.5,
    noise: float = 0.5,
    wall: bool = False,
    lens: Camera = LENS,
    pattern: bool = False,
    seed: int = 5,
) -> Tabletop:
    """Things (mesh, T_world_object) on a square table of edge 2 `half` [m], with a floor 0.7 m below.

    Args:
        things: Meshes and poses.
        eye: T_world_camera.
        half: Half the table's edge [m].
        noise: Depth noise as a part of the noise model's.
        wall: A wall stands behind the table.
        lens: Size and intrinsics of the picture.
        pattern: All surfaces have a pattern, which features match.
        seed: Of the noise.
    """
    table = factories.box_mesh((-half, -half, -0.03), (half, half, 0.0), colour=(0.65, 0.5, 0.35))
    floor = factories.box_mesh((-3, -3, -0.8), (3, 3, -0.7), colour=(0.4, 0.4, 0.4))
    back = factories.box_mesh((-3, 1.0, -0.8), (3, 1.1, 2.0), colour=(0.9, 0.9, 0.85))
    still = [table, floor] + ([back] if wall else [])
    surfaces = [raycast.Surface(m.vertices, m.faces, colour=m.colour) for m in still]
    for mesh, pose in things:
        placed = transforms.apply(pose, mesh.vertices)
        surfaces.append(raycast.Surface(placed, mesh.faces, colour=mesh.colour))
    seen = raycast.render(surfaces, lens.matrix(), eye, lens.height, lens.width)
    rng = np.random.default_rng(seed)
    depth = np.where(seen.index >= 0, seen.depth, 0.0)
    depth += (depth > 0) * noise * planes.depth_sigma(depth) * rng.standard_normal(depth.shape)
    # Faces differ a little in brightness, as under a lamp.
    light = 0.75 + 0.25 * np.clip(seen.normal @ np.array([0.3, -0.4, 0.87]), 0, 1)
    if pattern:
        light *= _pattern(seen.depth, lens, eye)
    pixels = raycast.shade(surfaces, seen) * light[..., None] + rng.normal(0, 2, (*depth.shape, 3))
    capture = factories.rgbd(np.clip(pixels, 0, 255).astype(np.uint8), np.maximum(depth, 0).astype(np.float32), lens)
    labels = np.maximum(seen.index - len(still) + 1, 0).astype(np.int32)
    return Tabletop(capture, LabelImage(labels=labels), eye)


def _pattern(depth: np.ndarray, lens: Camera, eye: np.ndarray) -> np.ndarray:
    """Brightness (H, W) of what a camera sees: cubes of two sizes with random shades, fixed in the world."""
    points = transforms.apply(eye, cameras.backproject(np.where(np.isfinite(depth), depth, 0.0), lens.matrix()))
    shades = np.random.default_rng(0).uniform(0.55, 1.0, (2, 64, 64, 64))
    found = np.ones(depth.shape)
    for shade, size in zip(shades, (0.023, 0.061), strict=True):
        i, j, k = np.moveaxis(np.floor(points / size + 0.37).astype(int) % 64, -1, 0)
        found *= shade[i, j, k]
    return found


def box(width: float, depth: float, height: float, colour: tuple[float, float, float]) -> Mesh:
    """A box on z = 0, its middle over the origin [m]."""
    return factories.box_mesh((-width / 2, -depth / 2, 0.0), (width / 2, depth / 2, height), colour)


def revolved(profile: list[tuple[float, float]], colour: tuple[float, float, float], sides: int = 48) -> Mesh:
    """The surface of revolution of (radius, height) corners [m], from the outer base to the inner one."""
    angle = np.arange(sides) * 2 * np.pi / sides
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(sides, h)], axis=1) for r, h in profile]
    faces = []
    for ring in range(len(profile) - 1):
        for i in range(sides):
            j = (i + 1) % sides
            a, b, c, d = (ring * sides + i, ring * sides + j, ring * sides + sides + i, ring * sides + sides + j)
            faces += [(a, b, d), (a, d, c)]
    return Mesh(vertices=np.concatenate(rings).astype(np.float32), faces=np.array(faces, np.int32), colour=colour)


def bowl(colour: tuple[float, float, float] = (0.9, 0.9, 0.9)) -> Mesh:
    """A bowl, 0.16 m wide and 0.06 m high, open upwards, walls of 5 mm."""
    outer = [(0.0, 0.0), (0.045, 0.0), (0.08, 0.06), (0.075, 0.06), (0.042, 0.005), (0.0, 0.005)]
    return revolved(outer, colour)


def cylinder(radius: float, height: float, colour: tuple[float, float, float]) -> Mesh:
    """A closed cylinder on z = 0 [m]."""
    return revolved([(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)], colour)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two masks."""
    return float((a & b).sum() / max(1, (a | b).sum()))


def write(capture: Capture, folder: Path, *, measured: bool = True) -> None:
    """Write the folder that `capture.folder` reads, with depth in millimetres or without depth."""
    folder.mkdir(parents=True)
    Image.fromarray(capture.photograph.rgb.pixels).save(folder / "rgb.png")
    facts = capture.photograph.camera.model_dump()
    if measured:
        assert capture.measured is not None
        Image.fromarray(np.round(capture.measured.depth.depth * 1000.0).astype(np.uint16)).save(folder / "depth.png")
        facts["depth_scale_m"] = 0.001
    (folder / "capture.json").write_text(json.dumps(facts))
