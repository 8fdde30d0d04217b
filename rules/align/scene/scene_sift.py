"""Backend `sift` of align.scene: matches by SIFT, mutual nearest neighbours, and the ratio test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context

from ..matches import matches_sift
from ..matches.matches_sift import SiftOptions
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
    """Theta of the scene, from pairs of backend `sift` of align.matches."""
    taken = matches_sift.points_of(given.capture.photograph.rgb, common.points)

    def match(drawn: Image, photograph: Image) -> Matches:
        """The photograph's keypoints are computed once."""
        return matches_sift.paired(matches_sift.points_of(drawn, common.points), taken, options.ratio)

    return fitted(ctx, given, match, common)
