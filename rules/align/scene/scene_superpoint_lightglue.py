"""Backend `superpoint_lightglue` of align.scene: points as in the paper, paired by LightGlue."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context

from ..matches import matches_superpoint_lightglue as superpoint
from ..matches.matches_superpoint_lightglue import SuperpointLightglueOptions
from .fitted import Fitted, Given
from .fitting import fitted

if TYPE_CHECKING:
    from .scene import SceneOptions

BACKEND = Backend(
    summary="points by SuperPoint and LightGlue, then the objective of Eq. 1",
    packages=("numpy", "open3d", "opencv-python-headless", "pycolmap", "scipy", "torch", "transformers"),
    extra="models",
    gpu_gb=2.0,
    cpu=True,
    weights=("lightglue_superpoint",),
    licence="SuperPoint: non-commercial research; LightGlue: Apache-2.0",
)


def fit(ctx: Context, given: Given, common: SceneOptions, options: SuperpointLightglueOptions) -> Fitted:
    """Theta of the scene, from pairs of backend `superpoint_lightglue` of align.matches."""
    matcher = ctx.load(superpoint.load, "lightglue_superpoint")
    return fitted(
        ctx,
        given,
        lambda one, other: superpoint.matched(matcher, one, other, common.points, options.least_confidence),
        common,
    )
