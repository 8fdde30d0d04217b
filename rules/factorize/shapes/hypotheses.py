"""Candidate body families for a view, and how to finish the best one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from . import wall_pieces
from .evidence import Evidence
from .families import box, extruded, lofted, mirrored, panels, revolution, tilted
from .families.names import HYPOTHESES
from .families.profile import FACETS, Layout, Profile
from .refine import Model


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
    """Parameter -> name of the length that the view may leave undetermined."""
    finer: Callable[[np.ndarray], Candidate] | None = None
    """Makes the same body with more parameters, started from the fitted ones."""
    settled: Callable[[np.ndarray], Model] | None = None
    """Makes the body without parameters that only help the fit; its single start is refined last."""


def propose(evidence: Evidence, allowed: tuple[str, ...], wall_m: float) -> list[Candidate]:
    """Candidates of the allowed families that are plausible for the view."""
    makers: dict[str, Callable[[], Candidate | None]] = {
        "box": lambda: _box(evidence),
        "tilted_box": lambda: _tilted(evidence),
        "cylinder": lambda: _cylinder(evidence),
        "lying_cylinder": lambda: _lying(evidence),
        "revolved": lambda: _revolved(evidence, hollow=False, wall_m=wall_m),
        "revolved_hollow": lambda: _revolved(evidence, hollow=True, wall_m=wall_m),
        "oval": lambda: _lofted(*lofted.oval(evidence), wall_m),
        "extruded": lambda: _extruded(evidence),
        "panels": lambda: _panels(evidence),
        "mirrored": lambda: _mirrored(evidence),
    }
    made = [makers[name]() for name in HYPOTHESES if name in allowed]
    return [candidate for candidate in made if candidate is not None]


def _box(evidence: Evidence) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        body = box.box_body(p)
        return Finished(body, box.upright(p[0], p[1], p[2]), (body.vertices,))

    return Candidate(box.box(evidence), finish, {3: "x", 4: "y"}, settled=box.standing)


def _tilted(evidence: Evidence) -> Candidate | None:
    made = tilted.tilted(evidence)
    if made is None:
        return None
    frames, model = made

    def finish(p: np.ndarray) -> Finished:
        body = tilted.tilted_body(p)
        return Finished(body, tilted.tilted_pose(frames, p), (body.vertices,))

    return Candidate(model, finish, {7: "x", 8: "y", 9: "z"})


def _cylinder(evidence: Evidence) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        body = Profile(np.array([0.0, p[2]]), p[[3, 3]], p[[3, 3]]).solid(FACETS)
        return Finished(body, box.upright(p[0], p[1], 0.0), (body.vertices,))

    return Candidate(lofted.cylinder(evidence), finish)


def _lying(evidence: Evidence) -> Candidate:
    def finish(p: np.ndarray) -> Finished:
        body = box.lying_body(p, FACETS)
        return Finished(body, box.upright(p[0], p[1], p[2]), (body.vertices,))

    return Candidate(box.lying(evidence), finish)


def _revolved(evidence: Evidence, *, hollow: bool, wall_m: float) -> Candidate | None:
    centre, _ = revolution.axis(evidence)
    if hollow and revolution.interior(evidence, centre) < 0.03:
        return None
    return _lofted(*lofted.revolved(evidence, hollow=hollow, wall_m=wall_m), wall_m)


def _lofted(layout: Layout, model: Model, wall_m: float) -> Candidate:
    def finer(p: np.ndarray) -> Candidate:
        more, start = layout.finer(p)
        return _lofted(more, lofted.model(more, model.name, [start], wall_m), wall_m)

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
