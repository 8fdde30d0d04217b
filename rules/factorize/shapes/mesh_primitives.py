"""Closed meshes from one view without learned weights: fits families of simple bodies and keeps the best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.objects.object import Rival, Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import doubt
from . import evidence as evidence_of
from .families.names import GENERAL, HYPOTHESES
from .handle import with_handle
from .hypotheses import Candidate, Finished, propose
from .paint import HALF_TURN, MIRROR
from .refine import descend, fit, undetermined
from .scoring import Judgement, judge
from .shaped import lifted, shaped
from .standing_hull import standing_hull

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="boxes, vessels, revolved, lying, extruded, hinged and mirrored bodies, superquadrics, fitted to the view",
    profiles=("cpu",),
    packages=("manifold3d", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)

HANDLED = ("revolved", "revolved_hollow", "cylinder", "tilted_revolved_hollow")
"""Families that may have a handle."""
HOLLOW = ("revolved_hollow", "open_box", "tilted_revolved_hollow", "tilted_open_box")
HALF_TURN_SYMMETRIC = ("box", "tilted_box", "lying_cylinder", "oval", "open_box", "superquadric")
MIRROR_SYMMETRIC = ("mirrored", "lying")


class PrimitivesOptions(Options):
    """Options of backend `primitives` of factorize.mesh."""

    hypotheses: tuple[str, ...] = HYPOTHESES
    """Body families to fit."""
    wall_m: PositiveFloat = 0.003
    """Wall thickness of a vessel if the view does not show it [m]."""
    refine_steps: NonNegativeInt = 14
    """Maximum least-squares steps per hypothesis; the best one gets three times as many."""
    explained: float = Field(0.85, le=1.0)
    """Score of a body at which slow, general families are not tried."""


@dataclass(frozen=True)
class _Fitted:
    """A family's best body."""

    candidate: Candidate
    parameters: np.ndarray
    score: float
    volume: float
    """[m^3]"""


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: PrimitivesOptions
) -> Shape:
    """Return the closed, textured body that best explains the view.

    Args:
        ctx: The rule's context.
        view: The view.
        measured: Its depth, which the fit needs.
        common: The rule's options.
        options: The backend's.
    """
    seen = measured.needed().upright()
    evidence = evidence_of.gather(seen)
    if len(evidence.points) < common.least_points:
        why = f"{len(evidence.points)} pixels with trusted depth, {common.least_points} are needed to fit a body"
        return _stand_in(ctx, evidence, seen, common, why)
    size = float(np.ptp(evidence.points, axis=0).max())
    ctx.check(
        2.0 * options.wall_m < size,
        f"two walls of {1e3 * options.wall_m:.3g} mm are thicker than the object, which is {1e3 * size:.3g} mm large",
        hint="`wall_m` is in metres: `primitives: {wall_m: 0.003}`",
    )
    fitted = _fits(ctx, evidence, options)
    if not fitted:
        return _stand_in(ctx, evidence, seen, common, "no family of bodies fits the view")
    best = max(fitted, key=lambda found: found.score)
    body, judged, left = _finished(best, evidence, options.refine_steps)
    scores = {found.candidate.model.name: found.score for found in sorted(fitted, key=lambda found: found.score)}
    shape = _shape(best.candidate.model.name, body, judged, scores, seen, common)
    covariance = left.doubt.pose.copy()
    covariance[5, 5] += body.turn_sigma**2
    pose = Pose(parent="world", child="object", matrix=body.pose, covariance=covariance)
    return shape.model_copy(
        update={
            "pose": pose,
            "unobserved": left.loose,
            "size_sigma": left.doubt.size_sigma,
            "volume_sigma": left.doubt.volume_sigma,
            "rival": _rival(best, fitted),
        }
    )


def _fits(ctx: Context, evidence: evidence_of.Evidence, options: PrimitivesOptions) -> list[_Fitted]:
    """The best body of each family; a family that cannot be fitted to the view is left out with a warning."""
    fitted: list[_Fitted] = []
    names = [name for name in HYPOTHESES if name in options.hypotheses]
    if not names:
        ctx.fail("no hypothesis is left to try", hint="allow more `hypotheses`", known=listing(HYPOTHESES))
    for done, name in enumerate(names):
        if name in GENERAL and max((found.score for found in fitted), default=0.0) >= options.explained:
            break
        ctx.progress(done, len(names), name)
        try:
            fitted += [
                _fitted(candidate, evidence, options.refine_steps)
                for candidate in propose(evidence, (name,), options.wall_m)
            ]
        except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
            ctx.warn(f"{name} was not tried: {type(error).__name__}: {error}")
    return fitted


def _stand_in(ctx: Context, evidence: evidence_of.Evidence, seen: Seen, common: MeshOptions, why: str) -> Shape:
    """The convex hull of the seen points, with a warning, so that one poor view does not fail the whole scene."""
    body = standing_hull(evidence)
    if body is None:
        ctx.fail(
            f"the view has {len(evidence.points)} pixels with trusted depth, too few for any body",
            mask=f"{int(seen.mask.sum()):,} pixels, {int((seen.mask & (seen.depth > 0)).sum()):,} with depth",
            hint="set the element's `interactive: false` in a `scene.yaml`, or capture it nearer",
        )
    ctx.warn(f"{why}: the convex hull of the seen points is used")
    judged = judge(body.solid.moved(body.pose), evidence)
    body = lifted(body, evidence.base)
    return _shape("hull", body, judged, {"hull": judged.score}, seen, common)


def _fitted(candidate: Candidate, evidence: evidence_of.Evidence, steps: int) -> _Fitted:
    found = fit(candidate.model, evidence, steps)
    body = candidate.model.build(found.parameters)
    score = judge(body, evidence, candidate.model.cost).score
    return _Fitted(candidate, found.parameters, score, body.volume)


def _rival(best: _Fitted, fitted: list[_Fitted]) -> Rival | None:
    """The second-best hypothesis; bodies are compared as the search found them, without details and handles."""
    others = [found for found in fitted if found is not best]
    if not others:
        return None
    second = max(others, key=lambda found: found.score)
    name = second.candidate.model.name
    return Rival(
        hypothesis=name,
        volume_ratio=max(second.volume, 1e-12) / max(best.volume, 1e-12),
        hollow=name in HOLLOW,
        gap=best.score - second.score,
    )


@dataclass(frozen=True)
class _Left:
    """Uncertainty that the view leaves."""

    loose: tuple[str, ...]
    """Sizes that the view does not determine."""
    doubt: doubt.Doubt


def _finished(best: _Fitted, evidence: evidence_of.Evidence, steps: int) -> tuple[Finished, Judgement, _Left]:
    """Refine the winner longer, and add detail and a handle if they explain the view better."""
    cost = best.candidate.model.cost
    candidate, parameters = best.candidate, descend(best.candidate.model, evidence, best.parameters, steps).parameters
    loose = undetermined(candidate.model, evidence, parameters, tuple(candidate.sizes))
    left = _Left(
        tuple(candidate.sizes[index] for index in loose),
        doubt.of_fit(candidate.model, evidence, parameters, candidate.finish, loose),
    )
    if candidate.settled is not None:
        settled = candidate.settled(parameters)
        parameters = descend(settled, evidence, settled.starts[0], steps).parameters
    choices = [candidate.finish(parameters)]
    if candidate.finer is not None:
        detailed = candidate.finer(parameters)
        choices.append(detailed.finish(descend(detailed.model, evidence, detailed.model.starts[0], steps).parameters))
    judged = [judge(body.solid.moved(body.pose), evidence, cost) for body in choices]
    winner = int(np.argmax([mark.score for mark in judged]))
    body, mark = choices[winner], judged[winner]
    if candidate.model.name in HANDLED:
        handled = with_handle(body, evidence)
        # A strap that extends below the base belongs to something else in the mask.
        if handled is not None and handled.solid.vertices[:, 2].min() > -1e-6:
            again = judge(handled.solid.moved(handled.pose), evidence, cost)
            if again.score > mark.score:
                body, mark = handled, again
    return lifted(body, evidence.base), mark, left


def _shape(
    name: str, body: Finished, judged: Judgement, scores: dict[str, float], seen: Seen, options: MeshOptions
) -> Shape:
    symmetry = HALF_TURN if name in HALF_TURN_SYMMETRIC else MIRROR if name in MIRROR_SYMMETRIC else None
    return shaped(name, body, judged, scores, seen, options.texture_px, symmetry, revolved=name in HANDLED)
