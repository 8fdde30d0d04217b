"""reference.convex_pieces: convex decomposition of an object, so that it can fall and rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.scenes.world import Thing
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.geometry import convex
from dextera_build.rule import Context, Fraction, Options, rule

from .. import solids

if TYPE_CHECKING:
    from manifold3d import Manifold


class ConvexPiecesOptions(Options):
    """Options of reference.convex_pieces."""

    threshold: Fraction = 0.1
    """Largest concavity of a piece, as CoACD defines it."""
    most: PositiveInt = 24
    """Maximum number of pieces."""
    convexity: Fraction = 0.9
    """Fraction of its convex hull's volume above which a closed object is one piece."""
    faces: PositiveInt = 3000
    """Number of faces to which a closed surface is simplified before the decomposition."""
    seed: NonNegativeInt = 0
    """Seed of CoACD."""


@rule(version=1, packages=("coacd", "manifold3d", "numpy", "scipy"), cpus=1)
def convex_pieces(ctx: Context, thing: Thing, *, options: ConvexPiecesOptions | None = None) -> Thing:
    """Return the object with the convex pieces of its first part [m], found by CoACD from all parts together."""
    options = options or ConvexPiecesOptions()
    found = _decomposed(thing.surface, options)
    ctx.say(f"{len(found)} {'piece' if len(found) == 1 else 'pieces'}")
    first, *others = thing.parts
    parts = {first: thing.parts[first].model_copy(update={"pieces": found})}
    return thing.model_copy(update={"parts": parts | {name: thing.parts[name] for name in others}})


def _decomposed(surface: Mesh, options: ConvexPiecesOptions) -> tuple[Hull, ...]:
    vertices, faces = surface.vertices.astype(np.float64), surface.faces
    closed = solids.solid(surface)
    if not closed.is_empty():
        if closed.volume() >= options.convexity * closed.hull().volume():
            return (Hull(vertices=convex.surface(vertices)[0]),)
        mesh = _simplified(closed, options.faces).to_mesh64()
        vertices, faces = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int32)
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(vertices, faces),
        threshold=options.threshold,
        max_convex_hull=options.most,
        # Published surfaces may be open or self-intersecting; voxels close them.
        preprocess_mode="on" if closed.is_empty() else "off",
        preprocess_resolution=40,
        mcts_nodes=10,
        mcts_iterations=20,
        seed=options.seed,
    )
    hulls = [Hull(vertices=convex.surface(np.asarray(corners))[0]) for corners, _ in parts]
    return tuple(sorted(hulls, key=lambda hull: tuple(hull.vertices.mean(axis=0).tolist())))


def _simplified(solid: Manifold, faces: int) -> Manifold:
    tolerance = float(np.cbrt(solid.hull().volume())) * 1e-3
    small = solid
    while small.num_tri() > faces and tolerance < 0.01:
        small = solid.simplify(tolerance)
        tolerance *= 1.6
    return small
