"""From a capture and a scene to theta: initialisation, refinement, uncertainty."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.geometry.scene_alignment import Level, Problem, align, align_sparse
from dextera_build.geometry.scene_terms import Weights
from dextera_build.rule import Context

from . import beginning, drawing, evidence
from .beginning import Match, Start
from .fitted import Fitted, Given
from .levels import levels
from .viewpoints import around

if TYPE_CHECKING:
    from .scene import SceneOptions


def fitted(ctx: Context, given: Given, match: Match, options: SceneOptions) -> Fitted:
    """Theta of the scene; raises with properties of the photograph if there is no initial pose."""
    capture, scene, taken = given.capture, given.scene, given.taken
    shown = drawing.SplatScene(scene, ctx.device) if isinstance(scene, Splats) else drawing.MeshScene(scene)
    render = shown.whole()
    camera = capture.photograph.camera
    k, size = camera.matrix(), (camera.height, camera.width)
    own = render(taken, k, size)
    if not own.solid.any():
        ctx.fail("the scene is not seen from where its picture was taken", hint="give `taken`, T_scene_camera of it")
    unit = float(np.median(own.depth[own.solid]))
    places = ((place, render(place, k, size)) for place in around(taken, unit))
    known = None
    if given.image is not None and given.pairs is not None:
        drawn = render(taken, given.image.matrix(), (given.image.height, given.image.width))
        known = beginning.given(capture, given.image, given.pairs, (taken, drawn))
    begun, pairs = beginning.found(capture, render, match, chain([(taken, own)], places), options.enough, unit, known)
    start = _enough(ctx, capture, begun, pairs, options)
    weights = Weights(options.rgb, options.ssim, options.pixel, options.depth, options.surface)
    sparse = align_sparse(start.pose, start.matches, k, size, weights, unit)
    pyramid = levels(capture, given.ignored, options.widths, options.farthest_m)
    small = shown.around(sparse.pose.scene_from_camera, [(level.k, level.depth.shape) for level in pyramid])
    problem = Problem(start.matches, k, size, pyramid, small, weights, unit, options.apart)
    solution = align(sparse.pose, problem)
    seen = evidence.evidence(start, solution, pyramid[-1], k, size)
    # Errors of the photometric terms are common to the whole picture (light, colours shifted against their depth), so
    # no residual shows them: they refine the estimate, but the stated covariance is that of the points plus this shift.
    apart = sparse.pose.step_to(solution.pose, unit)
    steps = sparse.covariance + np.outer(apart, apart)
    if not np.isfinite(steps).all():
        ctx.fail(
            "the pairs are too few to estimate the error of the alignment",
            hint="capture more of the scene",
            inliers=len(start.matches),
        )
    assert solution.drawn is not None
    ctx.preview(_compared(pyramid[-1], solution.drawn), "the photograph, the scene from there, and both in squares")
    return Fitted(solution.pose, solution.pose.covariance(steps, unit), seen)


def _enough(ctx: Context, capture: Capture, start: Start | None, pairs: int, options: SceneOptions) -> Start:
    """The start; raises if there is none."""
    if start is None:
        ctx.fail(
            "the photograph was not found in the scene: no pose agrees with the points that look the same",
            hint="capture what the scene shows, from nearer to where its picture was taken, with light and sharp",
            pairs=pairs,
            **evidence.about(capture.photograph.rgb.pixels),
        )
    if len(start.matches) < options.limits.inliers and options.refuse:
        ctx.fail(
            f"the photograph was not found in the scene: {len(start.matches)} pairs agree with one pose, "
            f"{options.limits.inliers} are needed",
            hint="capture what the scene shows, from nearer to where its picture was taken, with light and sharp",
            pairs=start.tried,
            **evidence.about(capture.photograph.rgb.pixels),
        )
    return start


def _compared(level: Level, drawn: Drawn) -> np.ndarray:
    """Three pictures in a row, (H, 3 W, 3) uint8."""
    made = np.where(drawn.solid[..., None], drawn.rgb, 0.5)
    rows, columns = np.indices(drawn.depth.shape) // max(1, drawn.depth.shape[0] // 8)
    squares = np.where(((rows + columns) % 2 == 0)[..., None], made, level.rgb)
    return np.asarray(np.round(255 * np.hstack([level.rgb, made, squares]).clip(0, 1)), np.uint8)
