"""align.matches: corresponding points of two pictures."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Context, Options, Tolerance, rule


class MatchesOptions(Options):
    """Options of align.matches."""

    points: int = Field(2048, ge=8, le=100_000)
    """Maximum number of keypoints per picture."""


class MatchesBackend(Protocol):
    """Interface of a backend of align.matches."""

    def match(self, ctx: Context, first: Image, second: Image, common: MatchesOptions, options: Any) -> Matches:
        """Corresponding points of both pictures, in any order."""
        ...


# Pairs of nearly equal confidence change places, and one at the threshold comes or goes.
@rule(
    version=1,
    packages=("numpy",),
    tolerance=Tolerance(dict.fromkeys(("first", "second", "confidence"), math.inf), metrics={"pairs": 10}),
)
def matches(
    ctx: Context[MatchesBackend], first: Image, second: Image, *, options: MatchesOptions | None = None
) -> Matches:
    """Return pairs of pixels, best first. They are not verified geometrically, so they contain outliers."""
    found = ctx.backend.match(ctx, first, second, options or MatchesOptions(), ctx.backend_options)
    for points, picture in ((found.first, first), (found.second, second)):
        height, width = picture.pixels.shape[:2]
        inside = ((points >= -0.5) & (points <= (width - 0.5, height - 0.5))).all()
        ctx.check(bool(inside), "a point is outside its picture", hint="use backend `sift`")
    order = np.argsort(-found.confidence, kind="stable")
    ctx.say(f"{len(order):,} pairs by {found.method}")
    ctx.metric("pairs", float(len(order)))
    return Matches(
        first=found.first[order],
        second=found.second[order],
        confidence=np.clip(found.confidence[order], 0.0, 1.0),
        method=found.method,
    )
