"""align.scene: pose and scale of a generated scene against a measured photograph (the paper's Eq. 1)."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.camera import Capture, Photograph
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from .doubts import Limits, doubts
from .fitted import Fitted, Given


class SceneOptions(Options):
    """Options of align.scene: weights of Eq. 1 and acceptance limits."""

    frame: str = ""
    """Frame of the scene; empty: that of its Gaussians, or `world` for a mesh."""
    rgb: NonNegativeFloat = 20.0
    """lambda_rgb, weight of the mean squared difference of colours 0..1."""
    ssim: NonNegativeFloat = 1.0
    """lambda_ssim, weight of 1 - SSIM."""
    pixel: NonNegativeFloat = 10.0
    """lambda_pix, weight of the mean reprojection error in image diagonals."""
    depth: PositiveFloat = 4.0
    """lambda_dep, weight of the mean depth difference of points in metres; without it the scale is not determined."""
    surface: NonNegativeFloat = 0.0
    """Weight of the mean difference of all depths in metres, for measured scenes; not in Eq. 1."""
    widths: tuple[PositiveInt, ...] = Field((160, 320), min_length=1)
    """Widths at which pictures are compared, coarse to fine [px]."""
    apart: float = Field(0.06, gt=0.0, le=1.0)
    """Relative depth difference above which surfaces differ, because of a moved object or an occluder."""
    farthest_m: PositiveFloat = 8.0
    """Greater depths are ignored [m]."""
    points: PositiveInt = 4000
    """Maximum number of keypoints per picture."""
    enough: PositiveInt = 80
    """Number of inlier pairs at which no further viewpoint of the scene is tried."""
    limits: Limits = Limits()
    """Acceptance limits of an alignment."""
    refuse: bool = True
    """Whether an alignment that violates a limit is refused; otherwise it is returned with its doubts."""


class SceneBackend(Protocol):
    """Interface of a backend of align.scene."""

    def fit(self, ctx: Context, given: Given, common: SceneOptions, options: Any) -> Fitted:
        """Theta of the scene, with its covariance and evidence."""
        ...


# The fit iterates to convergence, and the matches that it begins with differ in their last digits.
@rule(
    version=3,
    packages=("numpy",),
    tolerance=Tolerance(
        {"": ROUNDING, "motion.matrix": 1e-5, "motion.scale": 1e-6, "motion.covariance": 1e-8, "evidence": 0.01}
    ),
)
def scene(
    ctx: Context[SceneBackend],
    capture: Capture,
    scene: Splats | Mesh,
    taken: Pose | None = None,
    robot: LabelImage | None = None,
    instances: InstanceMap | None = None,
    image: Photograph | None = None,
    matches: Matches | None = None,
    *,
    options: SceneOptions | None = None,
) -> SceneFit:
    """Return T_camera_scene [m] with the scale, its covariance, evidence and doubts, for a scene of unknown scale.

    The scene is rendered from `taken` (T_scene_camera of the picture that it was made from;
    the origin without it) and from poses around it, until enough points match the photograph. Then the four terms of
    Eq. 1 are minimised, coarse to fine. `robot` and `instances` are pixels of the photograph that show no part of the
    scene. `matches` of `align.matches`, from the picture `image` that the scene was made from to the photograph, are
    tried first.
    """
    options = options or SceneOptions()
    if capture.measured is None or not (capture.measured.depth.depth > 0).any():
        ctx.fail("the capture has no depth, so the scale is not determined", hint="align.scene needs an RGB-D capture")
    frame = options.frame or (scene.frame if isinstance(scene, Splats) else "world") or "scene"
    if taken is not None and taken.parent != frame:
        ctx.fail(f"`taken` is T_{taken.parent}_{taken.child}, but the scene is in frame `{frame}`")
    ignored = np.zeros(capture.photograph.rgb.pixels.shape[:2], bool)
    for name, mask in (("robot", robot), ("instances", instances)):
        if mask is not None:
            size = mask.labels.shape
            ctx.check(size == ignored.shape, f"`{name}` is of another picture", size=size)
            ignored |= mask.labels != 0
    ctx.check((image is None) == (matches is None), "`matches` and the `image` that they begin in are given together")
    lens = None if image is None else image.camera
    given = Given(capture, scene, np.eye(4) if taken is None else taken.matrix, ignored, lens, matches)
    fit = ctx.backend.fit(ctx, given, options, ctx.backend_options)
    motion = Similarity(
        parent="camera",
        child=frame,
        matrix=fit.pose.matrix,
        scale=fit.pose.scale,
        covariance=fit.covariance,
    )
    return _judged(ctx, SceneFit(motion=motion, evidence=fit.evidence), options)


def _judged(ctx: Context[SceneBackend], found: SceneFit, options: SceneOptions) -> SceneFit:
    seen = found.evidence
    made = found.model_copy(update={"doubts": doubts(seen, found.motion, options.limits)})
    for name, value, unit in (
        ("scale", found.motion.scale, ""),
        ("inliers", seen.inliers, ""),
        ("overlap", 100 * seen.overlap, "%"),
        ("residual", seen.residual_px, "px"),
        ("condition", seen.condition, ""),
    ):
        ctx.metric(name, float(value), unit)
    if made.doubts and options.refuse:
        ctx.fail(
            f"the scene could not be aligned: {made.doubts[0]}",
            hint="capture from nearer to where the scene's own picture was taken, with light and sharp",
            **{f"further {number}": text for number, text in enumerate(made.doubts[1:], 1)},
        )
    for text in made.doubts:
        ctx.warn(text)
    ctx.say(", ".join(made.facts()))
    return made
