"""Candidate body families for a view, and how to finish the best one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from . import wall_pieces
from .evidence import Evidence
from .families import (
    box,
    compartments,
    extruded,
    legged,
    lofted,
    lying,
    mirrored,
    open_box,
    panels,
    prism,
    revolution,
    superquadric,
    tilted,
    turned,
)
from .families.names import HYPOTHESES, TURNED, TURNED_PREFIX
from .families.profile import FACETS, Layout
from .refine import Model

TURNED_COST = 0.02
"""Additional complexity of a vessel that does not stand upright."""

COSTS = {"mirrored": mirrored.COST}
"""Complexity of the families that are slow to propose, by name."""


@dataclass(frozen=True)
class Finished:
    """A body in its own frame: origin at the centre of the base, z up."""

    solid: Solid
    pose: np.ndarray
    """T_world_object (4, 4)."""
    walls: tuple[np.ndarray, ...] = ()
    """Corner points (V, 3) of exact convex pieces, if known."""
    hollow: bool = False
    outside: Solid | None = None
    """A vessel without its cavity, in the same frame."""
    turn_sigma: float = 0.0
    """Standard deviation of the azimuth of a handle [rad]."""


@dataclass(frozen=True)
class Candidate:
    """A model and the functions that finish it."""

    model: Model
    finish: Callable[[np.ndarray], Finished]
    sizes: dict[int, str] = field(default_factory=dict)
    """Parameter -> name of the length that the view may not determine."""
    finer: Callable[[np.ndarray], Candidate] | None = None
    """Makes the same body with more parameters, initialised with the fitted ones."""
    following: Callable[[np.ndarray], Candidate | None] | None = None
    """Makes a body of another family from the fitted parameters, if the view shows one; both are judged."""
    settled: Callable[[np.ndarray], Model] | None = None
    """Makes the body without parameters that only help the fit; its single start is refined last."""


def propose(evidence: Evidence, allowed: tuple[str, ...], wall_m: float) -> list[Candidate]:
    """Candidates of the allowed families that are plausible for the view."""
    makers: dict[str, Callable[[], Candidate | None]] = {
        "box": lambda: standing_box(box.box(evidence), box.standing),
        "tilted_box": lambda: _tilted(evidence),
        "cylinder": lambda: upright_cylinder(lofted.cylinder(evidence)),
        "lying_cylinder": lambda: _lying(evidence),
        "revolved": lambda: _revolved(evidence, hollow=False, wall_m=wall_m),
        "revolved_hollow": lambda: _revolved(evidence, hollow=True, wall_m=wall_m),
        "oval": lambda: lofted_candidate(*lofted.oval(evidence), wall_m),
        "extruded": lambda: _extruded(evidence),
        "panels": lambda: _panels(evidence),
        "open_box": lambda: _open_box(evidence, wall_m),
        "prism": lambda: _prism(evidence),
        "superquadric": lambda: _superquadric(evidence),
        "lying": lambda: _lying_profile(evidence),
        "mirrored": lambda: _mirrored(evidence),
    }
    made = [makers[name]() for name in HYPOTHESES if name in allowed and name in makers]
    if "legged" in allowed:
        made += [_legged(*found) for found in legged.legged(evidence)]
    made += [one for name in TURNED if TURNED_PREFIX + name in allowed for one in _turned(name, evidence, wall_m)]
    return [candidate for candidate in made if candidate is not None]


def standing_box(model: Model, settled: Callable[[np.ndarray], Model] | None = None) -> Candidate:
    """An upright box: x, y, yaw, width, depth, height."""

    def finish(p: np.ndarray) -> Finished:
        body = box.box_body(p)
        return Finished(body, box.upright(p[0], p[1], p[2]), (body.vertices,))

    return Candidate(model, finish, {3: "x", 4: "y"}, settled=settled)


def _tilted(evidence: Evidence) -> Candidate | None:
    made = tilted.tilted(evidence)
    if made is None:
        return None
    frames, model = made

    def finish(p: np.ndarray) -> Finished:
        body = tilted.tilted_body(p)
        return Finished(body, tilted.tilted_pose(frames, p), (body.vertices,))

    return Candidate(model, finish, {7: "x", 8: "y", 9: "z"})


def upright_cylinder(model: Model) -> Candidate:
    """An upright cylinder: x, y, height, radius, and the depth of a lid if it is fitted."""

    def finish(p: np.ndarray) -> Finished:
        body = lofted.cylinder_profile(p).solid(FACETS)
        return Finished(body, box.upright(p[0], p[1], 0.0), (body.vertices,))

    return Candidate(model, finish)


def _lying(evidence: Evidence) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        body = box.lying_body(p, FACETS)
        return Finished(body, box.upright(p[0], p[1], p[2]), (body.vertices,))

    return Candidate(box.lying(evidence), finish)


def _revolved(evidence: Evidence, *, hollow: bool, wall_m: float) -> Candidate | None:
    centre, _ = revolution.axis(evidence)
    if hollow and revolution.interior(evidence, centre) < 0.03:
        return None
    return lofted_candidate(*lofted.revolved(evidence, hollow=hollow, wall_m=wall_m), wall_m)


def lofted_candidate(layout: Layout, model: Model, wall_m: float) -> Candidate:
    """A body of stacked cross-sections, see `families.lofted`."""

    def finer(p: np.ndarray) -> Candidate:
        more, start = layout.finer(p)
        return lofted_candidate(more, lofted.model(more, model.name, [start], wall_m), wall_m)

    return Candidate(model, lambda p: _finish_profile(layout, p), finer=finer)


def _finish_profile(layout: Layout, p: np.ndarray) -> Finished:
    profile = layout.profile(p).finer(int(np.clip(2 * layout.knots, 16, 18 if layout.hollow else 36)))
    body = profile.solid(FACETS)
    if profile.wall is None:
        return Finished(body, layout.pose(p))
    outer = profile.outer(FACETS)
    pieces = wall_pieces.ring_walls(outer, profile.inner(FACETS))
    return Finished(body, layout.pose(p), pieces, hollow=True, outside=solids.loft(outer))


def _extruded(evidence: Evidence) -> Candidate | None:
    made = extruded.extruded(evidence)
    if made is None:
        return None
    outline, model = made

    def finish(p: np.ndarray) -> Finished:
        return Finished(extruded.body(outline, p), box.upright(p[0], p[1], 0.0))

    return Candidate(model, finish)


def _panels(evidence: Evidence) -> Candidate | None:
    model = panels.panels(evidence)
    if model is None:
        return None

    def finish(p: np.ndarray) -> Finished:
        base, lid = panels.slabs(p)
        pose = box.upright(p[0], p[1], p[2])
        return Finished(solids.join([base, lid]), pose, (base.vertices, lid.vertices))

    return Candidate(model, finish)


def _mirrored(evidence: Evidence) -> Candidate | None:
    made = mirrored.mirrored(evidence)
    if made is None:
        return None
    front, model = made
    return Candidate(model, lambda p: Finished(*mirrored.finished(front, p)))


def _open_box(evidence: Evidence, wall_m: float) -> Candidate | None:
    model = open_box.open_box(evidence, wall_m)
    if model is None:
        return None

    def finish(p: np.ndarray) -> Finished:
        outside = solids.loft(open_box.rings(p)[0])
        pose = box.upright(p[0], p[1], p[2])
        return Finished(open_box.open_box_body(p), pose, open_box.walls(p), hollow=True, outside=outside)

    def following(p: np.ndarray) -> Candidate | None:
        found = compartments.compartments(evidence, model, p)
        return None if found is None else _compartments(*found)

    return Candidate(model, finish, following=following)


def _compartments(partition: compartments.Partition, model: Model) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        outside = solids.loft(open_box.rings(p[: compartments.OWN])[0])
        pose = box.upright(p[0], p[1], p[2])
        return Finished(partition.solid(p), pose, partition.pieces(p), hollow=True, outside=outside)

    return Candidate(model, finish)


def _legged(layout: legged.Layout, model: Model) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        pieces = layout.pieces(p)
        walls = tuple(piece.vertices for piece in pieces)
        return Finished(solids.union(pieces), box.upright(p[0], p[1], p[2]), walls)

    return Candidate(model, finish)


def _prism(evidence: Evidence) -> Candidate | None:
    made = prism.prism(evidence)
    if made is None:
        return None
    stencil, model = made

    def finish(p: np.ndarray) -> Finished:
        pose = box.upright(p[0], p[1], 0.0)
        return Finished(stencil.body(p), pose, stencil.pieces(p), hollow=bool(stencil.wells))

    return Candidate(model, finish)


def _superquadric(evidence: Evidence) -> Candidate:
    frames, model = superquadric.superquadric(evidence)

    def finish(p: np.ndarray) -> Finished:
        return _on_its_base(superquadric.body(p, 48, 24), lambda solid: superquadric.pose(solid, frames, p))

    return Candidate(model, finish)


def _lying_profile(evidence: Evidence) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        return _on_its_base(lying.body(p, 25, FACETS), lambda solid: lying.pose(solid, p))

    return Candidate(lying.lying(evidence), finish)


def _on_its_base(centred: Solid, pose: Callable[[Solid], np.ndarray]) -> Finished:
    """A centred body with its origin moved to the lowest point of its own z axis."""
    down = float(centred.vertices[:, 2].min())
    moved = pose(centred)
    moved[:3, 3] += moved[:3, 2] * down
    return Finished(Solid(centred.vertices - [0.0, 0.0, down], centred.faces), moved)


def _turned(name: str, evidence: Evidence, wall_m: float) -> list[Candidate]:
    """The vessel `name` about axes that are not upright."""
    made = []
    for world in turned.turned(evidence):
        for standing in propose(world.evidence, (name,), wall_m):
            made.append(_about(world, standing))
    return made


def _about(world: turned.Turned, standing: Candidate) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        body = standing.finish(p[turned.OWN :])
        return replace(body, pose=world.pose(p) @ body.pose)

    return Candidate(world.model(standing.model, TURNED_PREFIX + standing.model.name, TURNED_COST), finish)
