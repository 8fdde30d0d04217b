"""Things of the sequences: meshes that others made, a box with a lid, and a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Joint
from dextera_build.artifacts.scenes.world import Thing
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import lie, solids, transforms
from dextera_build.testing import RuleRunner
from tests.benchmarks import catalogue

SKIN = (0.78, 0.58, 0.47)


def foreign(scratch: Path, names: tuple[str, ...]) -> dict[str, Mesh]:
    """Textured meshes of the catalogue, z up, the middle of the base at the origin [m]."""
    known = catalogue.entries()
    files = {part[key] for name in names for part in known[name]["parts"] for key in ("file", "texture") if key in part}
    folder = Folder(files={path: (catalogue.FOLDER / path).read_bytes() for path in sorted(files)})
    options = {"entries": {name: known[name] for name in names}}
    found: Collection[Thing] = RuleRunner(scratch).run("reference.catalogue", folder=folder, options=options)
    return {name: next(iter(thing.parts.values())).mesh for name, thing in found.items.items()}


def painted(solid: solids.Solid, colour: tuple[float, float, float]) -> Mesh:
    """A solid in one colour."""
    return Mesh(vertices=solid.vertices.astype(np.float32), faces=solid.faces.astype(np.int32), colour=colour)


def carton(size: tuple[float, float, float], seed: int) -> Mesh:
    """A box with printed sides, the middle of its base at the origin."""
    random = np.random.default_rng(seed)
    solid = box(size)
    base = random.integers(60, 220, 3)
    pixels = np.tile(base.astype(np.uint8), (256, 256, 1))
    for _ in range(40):
        left, top = random.integers(0, 236, 2)
        wide, high = random.integers(6, 60, 2)
        pixels[top : top + high, left : left + wide] = random.integers(20, 250, 3)
    # Each face shows another part of the picture.
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    axis = np.abs(normal).argmax(axis=1)
    others = np.array([(1, 2), (0, 2), (0, 1)])[axis]
    corners = solid.vertices[solid.faces]
    scaled = (corners - solid.vertices.min(axis=0)) / np.ptp(solid.vertices, axis=0)
    uv = np.take_along_axis(scaled, np.repeat(others[:, None], 3, axis=1), axis=2)
    side = 2 * axis + (normal[np.arange(len(axis)), axis] > 0)
    uv = uv * [0.32, 0.48] + np.stack([side % 3 * 0.333, side // 3 * 0.5], axis=1)[:, None] + 0.005
    return Mesh(
        vertices=solid.vertices.astype(np.float32),
        faces=solid.faces.astype(np.int32),
        uv=uv.astype(np.float32),
        texture=Image(pixels=pixels),
    )


def box(size: tuple[float, float, float], at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> solids.Solid:
    """A box whose base is centred at a point."""
    x, y, z = np.array(size)
    corners = np.array([(i, j, k) for i in (-x / 2, x / 2) for j in (-y / 2, y / 2) for k in (0, z)]) + at
    from dextera_build.geometry import convex

    vertices, faces = convex.surface(corners)
    return solids.Solid(vertices.astype(np.float64), faces)


def chest() -> tuple[dict[str, Mesh], tuple[Joint, ...]]:
    """A box with a lid on a hinge at its back."""
    hinge = (0.0, 0.06, 0.08)
    body, lid = carton((0.16, 0.12, 0.08), 5), carton((0.16, 0.12, 0.025), 6)
    lid = lid.model_copy(update={"vertices": lid.vertices + np.float32([0, 0, 0.08])})
    joint = Joint(
        name="lid", type="revolute", parent="base", child="lid", origin=hinge, axis=(-1.0, 0.0, 0.0),
        lower=0.0, upper=2.0, position=0.0,
    )  # fmt: skip
    return {"base": body, "lid": lid}, (joint,)


def hand() -> Mesh:
    """A palm and four fingers, pointing along -y, the wrist at y = 0.16."""
    parts = [box((0.09, 0.10, 0.03), (0.0, 0.08, 0.0))]
    parts += [box((0.017, 0.08, 0.018), (x, -0.005, 0.006)) for x in (-0.035, -0.012, 0.012, 0.035)]
    parts += [box((0.055, 0.30, 0.05), (0.0, 0.28, -0.01))]
    whole = solids.join(parts)
    return painted(whole, SKIN)


def turned(axis: tuple[float, float, float], degrees: float) -> np.ndarray:
    """(4, 4) rotation about an axis through the origin."""
    way = np.array(axis, np.float64)
    return transforms.rigid(lie.rotation(way / np.linalg.norm(way) * np.radians(degrees)), np.zeros(3))
