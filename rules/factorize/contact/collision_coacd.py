"""Backend coacd of factorize.collision: exact walls, a single hull, wedges for containers, otherwise CoACD."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from dextera_build.artifacts.objects.object import Collision, Link, Pieces
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.rule import Backend, Context, Fraction, Options

from .. import manifolds
from . import cavity, decomposition, volume, wedges
from .picture import draw

if TYPE_CHECKING:
    from manifold3d import Manifold

    from .collision import CollisionOptions

BACKEND = Backend(
    summary="exact walls where known, else one hull, cut wedges (containers) or CoACD",
    profiles=("cpu",),
    # manifold3d first: a process whose first C++ module is coacd cannot import open3d any more (`std::bad_cast`).
    packages=("manifold3d", "coacd", "open3d", "scipy"),
    extra="twin",
    licence="MIT (CoACD), Apache-2.0 (manifold3d)",
)


SECTORS = 8
"""Number of wedges that replace CoACD's result if it exceeds its time limit."""


class CoacdOptions(Options):
    """Options of backend `coacd` of factorize.collision."""

    convexity: Fraction = 0.97
    """A link whose solid fills at least this fraction of its convex hull is replaced by the hull."""
    pieces: PositiveInt = 96
    """Maximum number of pieces per link."""
    threshold: float = Field(0.06, ge=0.01, le=1.0)
    """Concavity at which CoACD stops, as a fraction of the link's size."""
    faces: int = Field(1500, ge=4)
    """Approximate number of faces of the simplified mesh passed to CoACD."""
    attempts: PositiveInt = 3
    """Maximum number of finer cuts to meet `cavity_fill`; a count, not a time limit, for reproducible results."""
    seed: NonNegativeInt = 0
    """Seed of CoACD."""
    seconds: PositiveInt = 180
    """Limit of CoACD's processor time per link [s], far above what links need; a link that exceeds it is cut into
    wedges."""


def pieces(ctx: Context, link: Link, hollow: bool, common: CollisionOptions, options: CoacdOptions) -> Pieces:
    """Return the cheapest set of convex pieces that is accurate enough.

    Args:
        ctx: The rule's context.
        link: Closed mesh and, if known, its exact walls.
        hollow: Whether the body has a cavity that must stay open.
        common: The rule's options.
        options: The backend's.
    """
    solid = manifolds.solid(link.mesh)
    made = _pieces(ctx, link, solid, hollow, common, options)
    excess, lacking = volume.errors(solid, made.hulls)
    return made.model_copy(update={"excess": excess, "lacking": lacking})


def _pieces(
    ctx: Context, link: Link, solid: Manifold, hollow: bool, common: CollisionOptions, options: CoacdOptions
) -> Pieces:
    inside = cavity.find(link.mesh) if hollow else cavity.Cavity(np.zeros((0, 3)), 0.0)
    if link.walls:
        fill = cavity.fill(inside, link.walls)
        exact = Pieces(hulls=link.walls, method="walls", cavity_fill=fill)
        if fill is None or fill <= common.cavity_fill:
            return exact
        return min(exact, _container(solid, inside, common, options), key=lambda made: made.cavity_fill or 0.0)
    if solid.volume() >= options.convexity * solid.hull().volume():
        return Pieces(hulls=(_hull(solid, common.corners),), method="hull")
    if len(inside.points):
        return _container(solid, inside, common, options)
    hulls = _coacd(ctx, solid, common.corners, options)
    if hulls is None:
        ctx.warn(f"CoACD took more than {options.seconds} s; the link was cut into wedges")
        return Pieces(hulls=_wedges(solid, common.corners, options), method="wedges")
    return Pieces(hulls=hulls, method="coacd")


def picture(ctx: Context, collision: Collision, options: CoacdOptions) -> np.ndarray:
    """Pieces in distinct colours, (H, W, 3) uint8."""
    return draw([hull for link in collision.links.values() for hull in link.hulls])


def _container(solid: Manifold, inside: cavity.Cavity, common: CollisionOptions, options: CoacdOptions) -> Pieces:
    small = _simplified(solid, 2 * options.faces)
    allowed = common.cavity_fill * inside.volume
    best: Pieces | None = None
    for attempt in range(options.attempts):
        sectors = 16 + 8 * attempt
        # Four cuts per wedge may use half of the allowed excess, and joining the other half.
        cut = wedges.cut(small, sectors, 0.5 * allowed / (4 * sectors * 2**attempt))
        before = cavity.fill(inside, [_hull(piece, common.corners) for piece in cut]) or 0.0
        joined = wedges.join(cut, 0.9 * (allowed - before * inside.volume), options.pieces)
        hulls = tuple(_hull(piece, common.corners) for piece in joined)
        fill = cavity.fill(inside, hulls) or 0.0
        if best is None or fill < (best.cavity_fill or 0.0):
            best = Pieces(hulls=hulls, method="wedges", cavity_fill=fill)
        if fill <= common.cavity_fill:
            break
    assert best is not None, "options.attempts is positive"
    return best


def _coacd(ctx: Context, solid: Manifold, corners: int, options: CoacdOptions) -> tuple[Hull, ...] | None:
    mesh = _simplified(solid, options.faces).to_mesh64()
    parts = decomposition.parts(
        np.asarray(mesh.vert_properties)[:, :3],
        np.asarray(mesh.tri_verts),
        ctx.scratch / "coacd",
        threshold=options.threshold,
        most=options.pieces,
        seed=options.seed,
        seconds=options.seconds,
    )
    if parts is None:
        return None
    hulls = [_hull_of_points(vertices, corners) for vertices in parts]
    return tuple(sorted(hulls, key=lambda hull: tuple(hull.vertices.mean(axis=0).tolist())))


def _wedges(solid: Manifold, corners: int, options: CoacdOptions) -> tuple[Hull, ...]:
    """Cut the solid with a fixed number of planes, which bounds the time."""
    small = _simplified(solid, 2 * options.faces)
    allowed = options.threshold * small.volume()
    cut = wedges.cut(small, SECTORS, 0.5 * allowed / (4 * SECTORS))
    return tuple(_hull(piece, corners) for piece in wedges.join(cut, 0.5 * allowed, options.pieces))


def _simplified(solid: Manifold, faces: int) -> Manifold:
    """The solid reduced to about so many faces, in small steps: a strong simplification would shrink it."""
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    tolerance = float(np.linalg.norm(high - low)) * 5e-5
    small = solid
    for _ in range(16):
        if small.num_tri() <= faces:
            break
        small = solid.simplify(tolerance)
        tolerance *= 1.4
    return small


def _hull(solid: Manifold, corners: int) -> Hull:
    return _hull_of_points(np.asarray(solid.hull().to_mesh64().vert_properties)[:, :3], corners)


def _hull_of_points(points: np.ndarray, corners: int) -> Hull:
    """Convex hull with at most about `corners` corners, all of them input points."""
    import manifold3d

    hull = manifold3d.Manifold.hull_points(np.asarray(points, np.float64))
    if hull.is_empty():
        return Hull(vertices=np.asarray(points, np.float32))
    tolerance = float(np.cbrt(hull.volume())) * 2e-3
    small = hull
    while small.num_vert() > corners:
        small = hull.simplify(tolerance).hull()
        tolerance *= 1.5
    vertices = np.asarray(small.to_mesh64().vert_properties)[:, :3].astype(np.float32)
    return Hull(vertices=np.unique(vertices, axis=0))
