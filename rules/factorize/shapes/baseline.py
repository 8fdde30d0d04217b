"""Shared code of the baselines of factorize.mesh: the seen points, and the shape of a body made from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import transforms
from dextera_build.geometry.solids import Solid
from dextera_build.rule import Context

from ..measured import Measurements
from . import evidence as evidence_of
from .evidence import Evidence
from .hypotheses import Finished
from .scoring import judge
from .shaped import lifted, shaped

if TYPE_CHECKING:
    from .mesh import MeshOptions


def shape_of(
    ctx: Context, name: str, measured: Measurements[Seen], common: MeshOptions, body_of: Callable[[Evidence], Solid]
) -> Shape:
    """The shape of the body returned by `body_of` for the seen points (world frame, the object stands on z = 0)."""
    seen = measured.needed()
    evidence = evidence_of.gather(seen)
    if len(evidence.points) < common.least_points:
        ctx.fail(
            f"the view has {len(evidence.points)} pixels with trusted depth, {common.least_points} are needed",
            hint="lower `least_points`, or use backend `stub`",
        )
    body = body_of(evidence)
    judged = judge(body, evidence)
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    base = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    own = Finished(Solid(body.vertices - base, body.faces), transforms.rigid(np.eye(3), base))
    return shaped(name, lifted(own, evidence.base), judged, {name: judged.score}, seen, common.texture_px)
