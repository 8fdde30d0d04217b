"""Closed meshes of simple things, and views of them as a depth camera would give."""

from __future__ import annotations

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Body, Link, Shape
from dextera_build.artifacts.objects.view import Instance, MeasuredView, ObjectView, Seen, Traits
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.geometry import raycast, solids
from dextera_build.geometry.solids import Solid
from tests import factories

TABLE = raycast.Surface(
    np.array([[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
    colour=(0.5, 0.4, 0.3),
)


def mesh(solid: Solid) -> Mesh:
    """The solid as an artifact."""
    return Mesh(vertices=solid.vertices.astype(np.float32), faces=solid.faces.astype(np.int32))


def turned(profile: list[tuple[float, float]], count: int = 64) -> Solid:
    """A vessel from its profile (radius, height) [m]: up the outside, over the rim and down the inside."""
    return solids.loft(np.array([solids.ring(r, r, 2.0, z, count) for r, z in profile]))


def bowl(radius: float = 0.08, height: float = 0.055, wall: float = 0.004) -> Solid:
    """A round-bottomed bowl."""
    angles = np.linspace(0.15, np.pi / 2, 14)
    outside = [(radius * np.sin(a), height * (1.0 - np.cos(a))) for a in angles]
    inside = [((radius - wall) * np.sin(a), height - (height - wall) * np.cos(a)) for a in angles[::-1]]
    return turned([*outside, *inside])


def cup(radius: float = 0.04, height: float = 0.09, wall: float = 0.004) -> Solid:
    """A straight cup without a handle."""
    return turned([(radius, 0.0), (radius, height), (radius - wall, height), (radius - wall, wall)])


def mug() -> Solid:
    """A cup with an angular handle on +x."""
    frame = solids.difference(
        solids.box((0.06, 0.012, 0.05), (0.04, 0, 0.045)), solids.box((0.04, 0.02, 0.03), (0.04, 0, 0.045))
    )
    hole = solids.box((0.068, 0.02, 0.2), (0.0, 0.0, 0.1))
    return solids.union([cup(), solids.difference(frame, hole)])


def bracket() -> Solid:
    """An L-shaped bar without any symmetry that a camera could confuse."""
    return solids.union(
        [solids.box((0.2, 0.05, 0.03), (0.0, 0.0, 0.015)), solids.box((0.04, 0.05, 0.08), (-0.08, 0, 0.06))]
    )


def laptop(opening: float, overlap: float = 0.0) -> tuple[Solid, list[Solid]]:
    """Base and lid that meet in a crease at y = 0.11, z = 0.018, open by `opening` [rad]; also the two slabs.

    Args:
        opening: 0 is closed.
        overlap: How far the lid reaches below the crease into the base [m]; above 0 the slabs become one solid.
    """
    base = solids.box((0.31, 0.22, 0.018), (0.0, 0.0, 0.009))
    flat = solids.box((0.31, 0.21 + overlap, 0.008), (0.0, (overlap - 0.21) / 2.0, 0.004))
    c, s = np.cos(-opening), np.sin(-opening)
    pose = np.array([[1, 0, 0, 0], [0, c, -s, 0.11], [0, s, c, 0.018], [0, 0, 0, 1.0]])
    lid = flat.moved(pose)
    whole = solids.union([base, lid]) if overlap else solids.join([base, lid])
    return whole, [base, lid]


def hull(solid: Solid) -> Hull:
    """A convex solid as a piece."""
    return Hull(vertices=solid.vertices.astype(np.float32))


def view(
    surface: Mesh,
    pose: np.ndarray,
    *,
    noise_m: float = 0.0,
    hidden: np.ndarray | None = None,
    category: str = "object",
    body_type: str = "rigid",
    material: str = "plastic",
    seed: int = 0,
) -> Instance:
    """What a camera in front of and above the table sees of `surface` at `pose` (T_world_object).

    Args:
        surface: Mesh in metres.
        pose: (4, 4).
        noise_m: Standard deviation of the depth [m].
        hidden: (240, 320) pixels behind an occluder.
        category: See `Element.category`.
        body_type: See `Element.body_type`.
        material: See `Element.material`.
        seed: Of the noise.
    """
    lens = Camera(width=320, height=240, fx=400.0, fy=400.0, cx=159.5, cy=119.5)
    eye = factories.look_at((0.1, -0.6, 0.45), (0.0, 0.0, 0.06))
    things = [raycast.posed(surface.vertices.astype(np.float64), surface.faces, pose), TABLE]
    seen = raycast.render(things, lens.matrix(), eye, 240, 320)
    depth = seen.depth + np.random.default_rng(seed).normal(0.0, noise_m, seen.depth.shape) * (seen.depth > 0.0)
    occluder = np.zeros(seen.depth.shape, bool) if hidden is None else hidden
    return Instance(
        view=ObjectView(
            rgb=Image(pixels=raycast.shade(things, seen)),
            mask=(seen.index == 0) & ~occluder,
            occluder=occluder,
            camera=lens,
            phrase="thing",
        ),
        traits=Traits(category=category, body_type=body_type, material=material),
        measured=MeasuredView(
            depth=DepthImage(depth=depth.astype(np.float32)), camera_pose=factories.placed(eye, "camera")
        ),
    )


def sights(instance: Instance) -> dict[str, Artifact]:
    """The inputs `view` and `measured` of a rule."""
    found: dict[str, Artifact | None] = {"view": instance.view, "measured": instance.measured}
    return {name: part for name, part in found.items() if part is not None}


def whole(instance: Instance) -> dict[str, Artifact]:
    """The inputs `view`, `measured` and `traits` of a rule."""
    return {**sights(instance), "traits": instance.traits}


def changed(instance: Instance, *, depth: np.ndarray | None = None, **pixels: np.ndarray) -> Instance:
    """The same object with another mask or occluder, or another depth (H, W) [m]."""
    assert instance.measured is not None
    measured = instance.measured
    if depth is not None:
        measured = measured.model_copy(update={"depth": DepthImage(depth=depth)})
    return instance.model_copy(update={"view": instance.view.model_copy(update=pixels), "measured": measured})


def seen(instance: Instance) -> Seen:
    """View and measurements together."""
    assert instance.measured is not None
    return Seen(instance.view, instance.measured)


def body(surface: Mesh, pose: np.ndarray | None = None, *, hollow: bool = False) -> Body:
    """A rigid body of one mesh."""
    where = np.eye(4) if pose is None else pose
    return Body(links={"base": Link(mesh=surface)}, pose=factories.placed(where), hollow=hollow)


def shape(surface: Mesh, walls: tuple[Hull, ...] = ()) -> Shape:
    """A shape that explains its view perfectly."""
    return Shape(
        mesh=surface,
        walls=walls,
        pose=factories.placed(np.eye(4)),
        hypothesis="panels",
        hollow=False,
        residual_m=0.0,
        mask_iou=1.0,
        unseen_fraction=0.5,
        scores={},
    )


def content(instance: Instance) -> str:
    """Digest of an object's crop, traits and depth: what rules can read of it."""
    return instance.encode(digest.of_bytes)
