"""The best body of each family for a view, and the shape made of the best of all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Rival, Shape
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose

from . import doubt
from .evidence import Evidence
from .handle import with_handle
from .hypotheses import Candidate, Finished
from .paint import HALF_TURN, MIRROR
from .refine import descend, fit, undetermined
from .scoring import Judgement, judge
from .shaped import lifted, shaped

if TYPE_CHECKING:
    from .mesh import MeshOptions

HANDLED = ("revolved", "revolved_hollow", "cylinder", "tilted_revolved_hollow")
"""Families that may have a handle."""
HOLLOW = ("revolved_hollow", "open_box", "compartments", "tilted_revolved_hollow", "tilted_open_box")
HOVERING, HIDDEN_M = 5.0, 0.03
"""Cost of the distance between a body and the surface under it [1/m], up to this distance [m]: what it stands on may be
hidden, as wheels are in the shadow of a bus. A body farther up stands on another one."""
HALF_TURN_SYMMETRIC = ("box", "tilted_box", "lying_cylinder", "oval", "open_box", "superquadric")
MIRROR_SYMMETRIC = ("mirrored", "lying")


@dataclass(frozen=True)
class Fitted:
    """A family's best body."""

    candidate: Candidate
    parameters: np.ndarray
    score: float
    volume: float
    """[m^3]"""


def fitted_of(candidate: Candidate, evidence: Evidence, steps: int, tries: int = 2) -> Fitted:
    """Fit a family from the best `tries` of its initial guesses, in at most `steps` steps.

    A body that may have a handle has the score with it if that is better: a family of any outline explains the handle
    from the start.
    """
    found = fit(candidate.model, evidence, steps, tries)
    body = candidate.model.build(found.parameters)
    hovers = max(0.0, float(body.vertices[:, 2].min()))
    cost = HOVERING * hovers if hovers < HIDDEN_M else 0.0
    score = judge(body, evidence, candidate.model.cost).score
    if candidate.model.name in HANDLED:
        handled = _handled(candidate.finish(found.parameters), evidence, candidate.model.cost)
        score = score if handled is None else max(score, handled[1].score)
    return Fitted(candidate, found.parameters, score - cost, body.volume)


def _handled(body: Finished, evidence: Evidence, cost: float) -> tuple[Finished, Judgement] | None:
    """The body with the handle that the mask shows, and its scores; None without one."""
    found = with_handle(body, evidence)
    # A strap that extends below the base belongs to something else in the mask.
    if found is None or found.solid.vertices[:, 2].min() <= -1e-6:
        return None
    return found, judge(found.solid.moved(found.pose), evidence, cost)


def followed(found: Fitted, evidence: Evidence, steps: int) -> list[Fitted]:
    """The body of another family that starts from a fitted one, if there is one; see `Candidate.following`."""
    following = found.candidate.following
    candidate = None if following is None else following(found.parameters)
    return [] if candidate is None else [fitted_of(candidate, evidence, steps)]


def _rival(best: Fitted, fitted: list[Fitted]) -> Rival | None:
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


def best_of(
    fitted: list[Fitted],
    evidence: Evidence,
    seen: Seen,
    common: MeshOptions,
    steps: int,
    whole: Evidence | None = None,
) -> Shape:
    """The textured shape of the body with the best score, with what the view leaves undetermined.

    Args:
        fitted: The best body of each family, at least one.
        evidence: The view, prepared.
        seen: The view.
        common: The rule's options.
        steps: Maximum number of further least-squares steps.
        whole: The view with the handle, if `evidence` is without it.
    """
    best = max(fitted, key=lambda found: found.score)
    body, judged, left = _finished(best, evidence, whole or evidence, steps)
    scores = {found.candidate.model.name: found.score for found in sorted(fitted, key=lambda found: found.score)}
    shape = shape_of(best.candidate.model.name, body, judged, scores, seen, common)
    covariance = left.doubt.pose.copy()
    covariance[5, 5] += body.turn_sigma**2
    return shape.model_copy(
        update={
            "pose": Pose(parent="world", child="object", matrix=body.pose, covariance=covariance),
            "unobserved": left.loose,
            "size_sigma": left.doubt.size_sigma,
            "volume_sigma": left.doubt.volume_sigma,
            "rival": _rival(best, fitted),
        }
    )


@dataclass(frozen=True)
class _Left:
    """Uncertainty that the view leaves."""

    loose: tuple[str, ...]
    """Sizes that the view does not determine."""
    doubt: doubt.Doubt


def _finished(best: Fitted, evidence: Evidence, whole: Evidence, steps: int) -> tuple[Finished, Judgement, _Left]:
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
    judged = [judge(body.solid.moved(body.pose), whole, cost) for body in choices]
    winner = int(np.argmax([mark.score for mark in judged]))
    body, mark = choices[winner], judged[winner]
    if candidate.model.name in HANDLED:
        handled = _handled(body, whole, cost)
        if handled is not None and handled[1].score > mark.score:
            body, mark = handled
    return lifted(body, evidence.base), mark, left


def shape_of(
    name: str, body: Finished, judged: Judgement, scores: dict[str, float], seen: Seen, options: MeshOptions
) -> Shape:
    """The textured shape of family `name`; see `shaped`."""
    symmetry = HALF_TURN if name in HALF_TURN_SYMMETRIC else MIRROR if name in MIRROR_SYMMETRIC else None
    return shaped(name, body, judged, scores, seen, options.texture_px, symmetry, revolved=name in HANDLED)
