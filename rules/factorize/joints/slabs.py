"""Fit two hinged slabs, or a box with a hinged lid, to the depth of an object that is known to have a joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from ..measured import Measurements
from ..shapes import evidence as evidence_of
from ..shapes.evidence import LEAST_POINTS, Evidence
from ..shapes.families import open_box, panels
from ..shapes.families.box import LARGEST_M, upright
from ..shapes.families.names import HYPOTHESES
from ..shapes.hypotheses import Finished
from ..shapes.refine import INDEPENDENT, Model, curvature, descend
from ..shapes.scoring import Judgement, judge
from ..shapes.shaped import lifted, shaped
from . import slab_starts
from .hinge import Hinge
from .hinge import find as find_crease

SLABS = "panels"
"""Name of the hypothesis of two slabs."""
BETTER = 0.02
"""Score difference above which one body explains a view better than another."""
REFLEX = 1.1 * np.pi
"""Angle between two slabs above which they are adjacent faces of one body [rad]."""
TRIES = 8
"""Number of starts that are refined."""
STEPS = (2, 5, 25)
"""Steps of each start, then of the best ones, then of the best one. A start's own loss says little about its fit: that
of the true height may be the largest of all."""
VESSEL_M = 0.035
"""Height of a base above which it may be a box rather than a slab [m]."""
WALL_M = 0.005
"""Expected thickness of the walls of a box [m]."""
THICKEST_LID_M = 0.03
"""Maximum thickness of a lid [m]."""
HIDDEN_M = 0.004
"""Standard deviation of the position of a hinge hidden by its lid [m], which the outside does not show."""
LARGEST_SIGMA_M = 0.01
"""Largest accepted standard deviation of the position of a hinge [m]."""
LEAST_SCORE = 0.88
"""Smallest accepted score of a body; see `scoring.judge`."""
LEAST_MESH = 0.8
"""Smallest score of a mesh whose crease is used where no slabs were fitted; meshes below it are slabs only by
default."""
GUESSED_STEPS = 30.0
"""Standard deviation of a parameter that the view does not determine, in its finite-difference steps."""


@dataclass(frozen=True)
class Slabs:
    """A hinged body that explains the view."""

    shape: Shape  # base and lid as two components
    hinge: Hinge  # in the frame of the shape
    score: float  # see `scoring.judge`
    better: bool  # whether it explains the view better than the shape that was given
    axis_sigma: float  # standard deviation of the hinge's direction [rad]
    origin_sigma: float  # standard deviation of the hinge's place [m]


def of_mesh(shape: Shape) -> Hinge | None:
    """The crease of a mesh; bodies of families other than two slabs have edges, but none is a hinge."""
    if shape.hypothesis in HYPOTHESES and shape.hypothesis != SLABS:
        return None
    if shape.scores.get(shape.hypothesis, 1.0) < LEAST_MESH:
        return None
    found = find_crease(shape.mesh)
    return None if found is None or found.angle >= REFLEX else found


def seen(shape: Shape, measured: Measurements[Seen]) -> Slabs | None:
    """Slabs that explain the depth about as well as the shape, or better; None if there are none, or without depth."""
    if measured.for_check() is None or (shape.hypothesis not in HYPOTHESES and of_mesh(shape) is not None):
        return None
    view = measured.needed().upright()
    evidence = evidence_of.gather(view)
    found = find(evidence, view) if len(evidence.points) >= LEAST_POINTS else None
    if found is None:
        return None
    rival = _score(shape, evidence)
    # The object is known to have a joint, so slabs win ties; slabs that are already in the mesh are kept.
    margin = BETTER if shape.hypothesis == SLABS else -BETTER
    return replace(found, better=found.score > rival + margin) if found.score > rival - BETTER else None


def _score(shape: Shape, evidence: Evidence) -> float:
    """How well a shape explains the view; minus infinity if its pose is unknown."""
    if shape.pose is None:
        return float("-inf")
    pose = shape.pose.matrix.copy()
    pose[2, 3] -= evidence.base
    solid = Solid(shape.mesh.vertices.astype(np.float64), shape.mesh.faces.astype(np.int64))
    return judge(solid.moved(pose), evidence).score


def find(evidence: Evidence, seen: Seen, texture_px: int = 1024) -> Slabs | None:
    """Fit a base and a lid to the measurements, starting with each large plane as the lid.

    Args:
        evidence: The view.
        seen: The same view, whose colours are painted on the body.
        texture_px: Largest width and height of the texture [px].

    Returns:
        The body; None if no body explains the view, or if the view does not determine its hinge.
    """
    found = _fitted(evidence, list(slab_starts.starts(evidence)))
    if found is None:
        return None
    model, p, judged = found
    if judged.score < LEAST_SCORE:
        return None
    axis_sigma, origin_sigma = _doubt(model, evidence, p)
    if _hidden(evidence, p):
        origin_sigma = float(np.hypot(origin_sigma, HIDDEN_M))
    if origin_sigma > LARGEST_SIGMA_M:
        return None
    body = lifted(Finished(_solid(p), upright(*p[:3]), _walls(p), hollow=len(p) > 9), evidence.base)
    shape = shaped(SLABS, body, judged, {SLABS: judged.score}, seen, texture_px)
    hinge = Hinge(np.array([0.0, p[4] / 2, p[5]]), np.array([-1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), float(p[8]))
    return Slabs(shape, hinge, judged.score, True, axis_sigma, origin_sigma)


def _fitted(evidence: Evidence, starts: list[np.ndarray]) -> tuple[Model, np.ndarray, Judgement] | None:
    """The best body: slabs, or a box with a lid where the base is high enough; its model, parameters and score."""
    models = [_model(start) for start in starts]
    if not models:
        return None
    first = [descend(model, evidence, model.starts[0], STEPS[0]) for model in models]
    order = np.argsort([fit.loss for fit in first], kind="stable")[:TRIES]
    short = [descend(models[k], evidence, first[k].parameters, STEPS[1]) for k in order]
    k = int(np.argmin([fit.loss for fit in short]))
    model = models[order[k]]
    p = descend(model, evidence, short[k].parameters, STEPS[2]).parameters
    choices = [(model, p)]
    if p[5] > VESSEL_M:
        vessel = _model(np.array([*p, WALL_M, WALL_M]))
        choices.append((vessel, descend(vessel, evidence, vessel.starts[0], STEPS[2]).parameters))
    judged = [judge(each.build(q), evidence, each.cost) for each, q in choices]
    best = int(np.argmax([mark.score for mark in judged]))
    return *choices[best], judged[best]


def _model(start: np.ndarray) -> Model:
    """Parameters of `panels`, and for a box additionally wall and floor thickness [m]."""
    inf, box = np.inf, len(start) > 9
    thin = panels.THINNEST_M
    lower = np.array([-inf, -inf, -inf, 0.02, 0.02, thin, 0.02, thin, 0.08, *[0.001, 0.001] * box])
    upper = np.array(
        [inf, inf, inf, LARGEST_M, LARGEST_M, LARGEST_M, LARGEST_M, THICKEST_LID_M, np.pi, *[0.02, 0.05] * box]
    )
    start = np.clip(start, lower, upper)
    return Model(
        name=SLABS,
        build=lambda p: _solid(p).moved(upright(p[0], p[1], p[2])),
        starts=[start],
        steps=np.array([0.003, 0.003, 0.015, 0.003, 0.003, 0.002, 0.003, 0.002, 0.02, *[0.0015, 0.002] * box]),
        lower=lower,
        upper=upper,
        expected=start,
        spread=np.array([inf, inf, inf, 0.1, 0.1, 0.05, 0.1, 0.003, 0.5, *[0.004, 0.01] * box]),
        cost=0.01,
    )


def _solid(p: np.ndarray) -> Solid:
    base, lid = panels.slabs(p[:9])
    return solids.join([solids.loft(np.concatenate(_rings(p))) if len(p) > 9 else base, lid])


def _rings(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rings of a box: outside (base, rim) and cavity (rim, floor), (2, 4, 3) each."""

    def ring(z: float, inset: float) -> np.ndarray:
        x, y = p[3:5] / 2 - inset
        return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])

    return open_box.nested(ring, p[5], p[9], p[10])


def _walls(p: np.ndarray) -> tuple[np.ndarray, ...]:
    """Corner points of exact convex pieces of base and lid."""
    base, lid = panels.slabs(p[:9])
    if len(p) <= 9:
        return base.vertices, lid.vertices
    return *open_box.between(*_rings(p)), lid.vertices


def _doubt(model: Model, evidence: Evidence, p: np.ndarray) -> tuple[float, float]:
    """Standard deviations of the hinge's direction [rad] and place [m], from the curvature of the fit."""
    normal, loss = curvature(replace(model, spread=np.full(len(p), np.inf)), evidence, p)
    steps = np.linalg.inv(INDEPENDENT / max(loss / 2.0, 1.0) * normal + np.eye(len(p)) / GUESSED_STEPS**2)
    slopes = np.stack([_place(p + step) - _place(p) for step in np.diag(model.steps)], axis=1)
    crease = upright(*p[:3])[:3, 0]
    off = slopes - np.outer(crease, crease @ slopes)
    return float(model.steps[2] * np.sqrt(steps[2, 2])), float(np.sqrt(np.trace(off @ steps @ off.T)))


def _place(p: np.ndarray) -> np.ndarray:
    """A point (3,) on the hinge in the world."""
    return np.asarray((upright(p[0], p[1], p[2]) @ [0.0, p[4] / 2, p[5], 1.0])[:3])


def _hidden(evidence: Evidence, p: np.ndarray) -> bool:
    """Whether the camera sees the lid from outside."""
    outward = upright(p[0], p[1], p[2])[:3, :3] @ [0.0, np.sin(p[8]), np.cos(p[8])]
    return bool(outward @ (evidence.eye - _place(p)) > 0.0)
