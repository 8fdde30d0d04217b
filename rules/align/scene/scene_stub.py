"""Backend stub of align.scene: the pose of the picture that the scene was made from, in metres, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.scenes.scene_fit import SceneEvidence
from dextera_build.geometry import transforms
from dextera_build.geometry.scene_pose import ScenePose
from dextera_build.rule import Backend, Context, Options

from .fitted import Fitted, Given

if TYPE_CHECKING:
    from .scene import SceneOptions

BACKEND = Backend(summary="no search: the scene in metres where its picture was taken", profiles=("stub",))


def fit(ctx: Context, given: Given, common: SceneOptions, options: Options) -> Fitted:
    """The inverse of `taken` at scale 1, with perfect evidence."""
    seen = SceneEvidence(
        pairs=100,
        inliers=100,
        spread=1.0,
        overlap=1.0,
        agreement=1.0,
        in_front=0.0,
        correlation=1.0,
        residual_px=0.0,
        residual_m=0.0,
        condition=1.0,
    )
    return Fitted(ScenePose(transforms.invert(given.taken), 1.0), 1e-6 * np.eye(7), seen)
