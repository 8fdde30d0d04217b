"""Backend `sift` of align.scene: the photograph is found by SIFT, mutual nearest neighbours, and the ratio test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context

from .. import matches_sift
from ..matches import MatchesOptions
from ..matches_sift import SiftOptions
from .fitted import Fitted, Given
from .fitting import fitted

if TYPE_CHECKING:
    from .scene import SceneOptions

BACKEND = Backend(
    summary="points by SIFT, then the objective of Eq. 1",
    profiles=("cpu",),
    packages=("numpy", "open3d", "opencv-python-headless", "pycolmap", "scipy"),
    extra="twin",
)


def fit(ctx: Context, given: Given, common: SceneOptions, options: SiftOptions) -> Fitted:
    """Theta of the scene, found by pairs as backend `sift` of align.matches finds them."""
    points = MatchesOptions(points=common.points)
    return fitted(ctx, given, lambda one, other: matches_sift.match(ctx, one, other, points, options), common)
