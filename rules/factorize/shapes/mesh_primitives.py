"""Closed meshes from one view without learned weights: fits families of simple bodies and keeps the best."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.errors import listing
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import evidence as evidence_of
from .families.names import COMPARTMENTS, GENERAL, HYPOTHESES
from .fitted import Fitted, best_of, fitted_of, followed, shape_of
from .hypotheses import COSTS, propose
from .scoring import BEST, judge
from .shaped import lifted
from .standing_hull import standing_hull

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="boxes, vessels, plates on legs, prisms, revolved, lying, hinged and mirrored bodies, fitted to the view",
    profiles=("cpu",),
    packages=("manifold3d", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


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
    return best_of(fitted, evidence, seen, common, options.refine_steps)


def _fits(ctx: Context, evidence: evidence_of.Evidence, options: PrimitivesOptions) -> list[Fitted]:
    """The best body of each family; a family that cannot be fitted to the view is left out with a warning."""
    fitted: list[Fitted] = []
    names = [name for name in HYPOTHESES if name in options.hypotheses]
    if not names:
        ctx.fail("no hypothesis is left to try", hint="allow more `hypotheses`", known=listing(HYPOTHESES))
    for done, name in enumerate(names):
        if name in GENERAL and max((found.score for found in fitted), default=0.0) >= options.explained:
            break
        if _is_out(name, fitted):
            continue
        ctx.progress(done, len(names), name)
        try:
            for candidate in propose(evidence, (name,), options.wall_m):
                found = fitted_of(candidate, evidence, options.refine_steps)
                fitted.append(found)
                if COMPARTMENTS in names:
                    fitted += followed(found, evidence, options.refine_steps)
        except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
            ctx.warn(f"{name} was not tried: {type(error).__name__}: {error}")
    return fitted


def _is_out(name: str, fitted: list[Fitted]) -> bool:
    """Whether a family is behind the two best whatever its fit, because of its complexity: neither result nor rival."""
    behind = sorted(found.score for found in fitted)[:-1]
    return bool(behind) and BEST - COSTS.get(name, 0.0) < behind[-1]


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
    return shape_of("hull", body, judged, {"hull": judged.score}, seen, common)
