"""Backend crease of factorize.articulate: two slabs, or a box and its lid, with a hinge at their crease."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydantic import NonNegativeFloat

from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.objects.view import Seen, State
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options

from .. import manifolds
from ..measured import Measurements
from . import slabs
from .hinge import Hinge
from .parts import Parts
from .picture import draw

if TYPE_CHECKING:
    from .articulate import ArticulateOptions

BACKEND = Backend(
    summary="hinge in the crease of two slabs, limits by sweeping the lid",
    profiles=("cpu",),
    packages=("manifold3d", "scipy"),
    extra="twin",
    uses=("screw",),
)

_AGREES = np.radians(3.0)
"""Largest difference between the angles of two fits of the same hinge [rad]."""
_STEPS = 12
"""Number of lid poses between closed and open that are checked for overlap."""


class CreaseOptions(Options):
    """Options of backend `crease` of factorize.articulate."""

    margin_rad: NonNegativeFloat = 0.1
    """Minimum distance of the upper limit beyond the observed opening [rad]."""
    clearance_m: NonNegativeFloat = 0.0002
    """Gap between the closed lid and the base [m]."""


def parts(
    ctx: Context,
    shape: Shape,
    measured: Measurements[Seen],
    again: State | None,
    common: ArticulateOptions,
    options: CreaseOptions,
) -> Parts | None:
    """Split the shape at its hinge and close the parts.

    If there is a second capture, backend `screw` is used instead.

    Returns:
        The links at joint position 0; None without a crease or if one solid spans both sides of it.
    """
    if again is not None:
        moved: Parts | None = ctx.other("screw").parts(shape, measured, again, common)
        return moved
    fitted = None if common.hinge else slabs.seen(shape, measured)
    mine = shape if fitted is None or not fitted.better else fitted.shape
    hinge = _declared(common) if common.hinge else fitted.hinge if fitted and fitted.better else slabs.of_mesh(shape)
    if hinge is None:
        return None
    halves = _split(mine.mesh, hinge)
    if halves is None:
        return None
    base, lid = halves
    hinge, lift = _seated(base, lid, hinge, options.clearance_m, lifted=common.hinge is None)
    base_solid, lid_solid = manifolds.solid(base), manifolds.solid(lid)
    area = _plan_area(lid, hinge)

    def overlap(position: float) -> float:
        moved = lid_solid.transform(hinge.turn(position - hinge.angle)[:3])
        return float((moved ^ base_solid).volume()) / area

    closing = max(overlap(position) for position in np.linspace(0.0, hinge.angle, _STEPS))
    upper = _upper(overlap, hinge.angle + options.margin_rad, common)
    closed = hinge.turn(-hinge.angle)
    own, theirs = _walls(mine, hinge)
    metrics = [("lifted", lift * 1000.0, "mm")]
    seen = measured.for_check()
    if seen is not None and (angle := _seen_angle(mine, seen, hinge)) is not None:
        metrics.append(("seen_minus_mesh", float(np.degrees(angle - hinge.angle)), "deg"))
    lid_walls = tuple(Hull(vertices=_apply(closed, hull.vertices)) for hull in theirs)
    links = {"base": Link(mesh=base, walls=own), "lid": Link(mesh=_moved(lid, closed), walls=lid_walls)}
    joint = _joint(hinge, upper)
    if fitted is not None:
        metrics.append(("slabs", fitted.score, ""))
        if abs(fitted.hinge.angle - hinge.angle) < _AGREES:
            sigmas = {"axis_sigma_rad": fitted.axis_sigma, "origin_sigma_m": fitted.origin_sigma}
            joint = joint.model_copy(update=sigmas)
    return Parts(links, (joint,), closing, tuple(metrics), mine)


def picture(ctx: Context, body: Body, seen: Seen, options: CreaseOptions) -> np.ndarray:
    """Draw the hinge on the crop, (H, W, 3) uint8."""
    return draw(body, seen)


def _declared(options: ArticulateOptions) -> Hinge:
    assert options.hinge is not None
    origin, axis = np.array(options.hinge.origin_m), np.array(options.hinge.axis)
    axis = axis / np.linalg.norm(axis)
    along = np.cross(np.array([0.0, 0.0, 1.0]), axis)
    return Hinge(origin, axis, along / np.linalg.norm(along), options.hinge.angle_rad)


def _split(mesh: Mesh, hinge: Hinge) -> tuple[Mesh, Mesh] | None:
    """Lower and upper part at the observed angle: whole components if there are several, otherwise a cut."""
    sides: list[list[np.ndarray]] = [[], []]
    for faces in manifolds.components(mesh):
        middle = mesh.vertices[mesh.faces[faces]].mean(axis=(0, 1), dtype=np.float64)
        sides[int(hinge.bisector @ (middle - hinge.origin) > 0.0)].append(faces)
    if all(sides):
        base, lid = (manifolds.subset(mesh, np.sort(np.concatenate(side))) for side in sides)
        return base, lid
    offset = float(hinge.bisector @ hinge.origin)
    above, below = manifolds.solid(mesh).split_by_plane(tuple(hinge.bisector), offset)
    if above.is_empty() or below.is_empty():
        return None
    return manifolds.mesh(below, mesh), manifolds.mesh(above, mesh)


def _seated(base: Mesh, lid: Mesh, hinge: Hinge, clearance_m: float, *, lifted: bool) -> tuple[Hinge, float]:
    """Move the axis until the closed lid rests `clearance_m` above the base; also return the lift [m]."""
    closed = _apply(hinge.turn(-hinge.angle), lid.vertices)
    below = _heights(base.vertices, hinge)
    lowest = _heights(closed, hinge)
    # Quantiles, because specks in a network's mesh would hold the lid up.
    lift = float(np.quantile(below, 0.99) - np.quantile(lowest, 0.01)) + clearance_m
    return (hinge.lifted(lift), lift) if lifted else (hinge, 0.0)


def _heights(vertices: np.ndarray, hinge: Hinge) -> np.ndarray:
    return np.asarray((vertices - hinge.origin) @ hinge.up)


def _plan_area(lid: Mesh, hinge: Hinge) -> float:
    """Area of the lid projected along its slab normal [m^2], from the faces that point inward when closed."""
    areas, normals = manifolds.areas_and_normals(lid)
    inward = hinge.turn(hinge.angle)[:3, :3] @ -hinge.up
    cosine = normals @ inward
    return float((areas * np.maximum(cosine, 0.0)).sum())


def _upper(overlap: Callable[[float], float], least: float, options: ArticulateOptions) -> float:
    """The widest collision-free opening, at least the observed one plus a margin."""
    free = least
    for position in np.linspace(least, max(options.upper_rad, least), _STEPS):
        if overlap(float(position)) > options.overlap_m:
            break
        free = float(position)
    return free


def _walls(shape: Shape, hinge: Hinge) -> tuple[tuple[Hull, ...], tuple[Hull, ...]]:
    """Walls of the lower and the upper link, at the observed angle."""
    sides: tuple[list[Hull], list[Hull]] = ([], [])
    for hull in shape.walls:
        middle = hull.vertices.mean(axis=0, dtype=np.float64)
        sides[int(hinge.bisector @ (middle - hinge.origin) > 0.0)].append(hull)
    # Exact walls of one side only do not describe both links.
    return (tuple(sides[0]), tuple(sides[1])) if all(sides) else ((), ())


def _seen_angle(shape: Shape, seen: Seen, hinge: Hinge) -> float | None:
    """Opening angle from a plane fitted to the seen points near the lid [rad], to check the mesh."""
    if shape.pose is None:
        return None
    valid = seen.mask & (seen.depth > 0.0)
    points = seen.camera_points(valid)
    to_object = (shape.pose.inverse() @ seen.measured.camera_pose).matrix
    local = transforms.apply(to_object, points) - hinge.origin
    inside = hinge.turn(hinge.angle)[:3, :3] @ hinge.along
    front = np.cross(hinge.axis, inside)
    near = (local @ inside > 0.02) & (np.abs(local @ front) < 0.008)
    if near.sum() < 200:
        return None
    offsets = local[near] - local[near].mean(axis=0)
    normal = np.linalg.svd(offsets.T @ offsets)[0][:, 2]
    direction = np.cross(normal, hinge.axis)
    direction *= np.sign(direction @ inside)
    return float(np.arctan2(direction @ hinge.up, direction @ hinge.along)) % (2.0 * np.pi)


def _joint(hinge: Hinge, upper: float) -> Joint:
    origin, axis = ([float(value) for value in vector] for vector in (hinge.origin, hinge.axis))
    return Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="lid",
        origin=(origin[0], origin[1], origin[2]),
        axis=(axis[0], axis[1], axis[2]),
        lower=0.0,
        upper=upper,
        position=hinge.angle,
    )


def _moved(mesh: Mesh, motion: np.ndarray) -> Mesh:
    return mesh.model_copy(update={"vertices": _apply(motion, mesh.vertices)})


def _apply(motion: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    return transforms.apply(motion, vertices.astype(np.float64)).astype(np.float32)
