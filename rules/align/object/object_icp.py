"""Backend icp of align.object: extent ratios, then ICP over similarities, judged by renders."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import kinematics, lie, registration, symmetry, transforms
from dextera_build.geometry.registration import ScaledPose, Search
from dextera_build.rule import Backend, Context

from . import lookalikes, overlay_picture, polish, silhouette, spread, starts
from .icp_options import IcpOptions
from .model_view import ModelView, Score, seen_points
from .placed import Placed

if TYPE_CHECKING:
    from .object import ObjectOptions

BACKEND = Backend(
    summary="Sim(3) ICP on render-visible points, chosen by render score",
    profiles=("cpu",),
    packages=("open3d", "scipy"),
    extra="twin",
)
_VERTICAL = np.cos(0.01)
"""Cosine of the tilt up to which a body's own up axis is used."""


def place(ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: IcpOptions) -> Placed:
    """Refine the body's own pose if it has a good one, otherwise try every orientation.

    Args:
        ctx: The rule's context.
        body: Links in mesh units, with the joint positions of the photograph.
        seen: The view to match.
        common: The rule's options.
        options: The backend's.
    """
    vertices, faces = kinematics.posed_surface(body)
    model = ModelView(vertices, faces, seen)
    if not (seen.depth > 0).any():
        return _by_silhouette(model, body, seen, options)
    points = seen_points(seen)
    guess = None if body.pose is None else ScaledPose(1.0, np.array(body.pose.matrix))
    score = None if guess is None else model.score(guess)
    alike = symmetry.find(vertices, faces, model.model_distances)
    ambiguous = alike.round_axis is not None
    if guess and score and score.iou >= options.guess_iou and score.violation <= common.most_violation:
        best, method = _refined(model, vertices, points, guess, score, options)
    else:
        best, others, method = starts.search(model, vertices, faces, seen, options)
        if guess and score and model.score(best).cost > score.cost - options.search_gain:
            best, method = guess, f"guess kept (IoU {score.iou:.2f}, {method} gained too little)"
        else:
            chosen = lookalikes.choose(model, body, seen, best, others, alike)
            thin = model.coarser(seen, 6000)
            best = polish.polished(thin, chosen.best, options.start_scale_sigma, lie.FREE)
            # A poor mask overlap does not determine the placement.
            ambiguous |= chosen.rivals > 0 or model.score(best).iou < options.sure_iou
            method += f", {chosen.rivals} look-alikes" if chosen.rivals else ""
    best, rested = _rested(model, vertices, best, options)
    placed = _result(model, vertices, points, best, method + rested, ambiguous=ambiguous)
    of_shape = None if body.pose is None else body.pose.covariance
    return replace(placed, placement=_with_spread(placed.placement, model, vertices, best, seen, of_shape, options))


def picture(ctx: Context, body: Body, seen: Seen, placement: Placement, options: IcpOptions) -> np.ndarray:
    """Draw the placed model on the crop, (H, W, 3) uint8."""
    return overlay_picture.draw(*kinematics.posed_surface(body), seen, placement)


def _by_silhouette(model: ModelView, body: Body, seen: Seen, options: IcpOptions) -> Placed:
    """The body's own pose if it explains the mask; else it stands on the support at the place and scale that do."""
    vertices, faces = kinematics.posed_surface(body)
    own = body.pose
    guess = None if own is None else ScaledPose(1.0, np.array(own.matrix))
    if own is None or guess is None or model.score(guess).iou < options.guess_iou:
        own, guess = None, silhouette.search(model, vertices, faces, seen)
    placement = Placement(
        pose=Pose(parent="world", child="object", matrix=guess.pose),
        scale=guess.scale,
        method="silhouette on the support" if own is None else "guess kept",
        ambiguous=symmetry.find(vertices, faces, model.model_distances).round_axis is not None,
        scale_sigma=None if own is None else 0.0,
    )
    if own is not None and own.covariance is not None:
        placement = _summed(placement, own.covariance, guess, seen)
    return Placed(placement, model.score(guess).iou, violation=0.0, gap_m=_lowest(vertices, guess))


def _refined(
    model: ModelView, vertices: np.ndarray, points: np.ndarray, guess: ScaledPose, score: Score, options: IcpOptions
) -> tuple[ScaledPose, str]:
    freedom = lie.FREE
    if guess.pose[2, 2] > _VERTICAL:
        standing = abs(_lowest(vertices, guess)) <= options.rest_m
        freedom = lie.resting() if standing else lie.UPRIGHT
    search = Search(freedom, guess.scale, options.guess_scale_sigma, model.noise_m, options.iterations)
    refined = registration.icp(guess, model.visible, points, search)
    gain = score.cost - model.score(refined).cost
    if gain < options.gain:
        return guess, f"guess kept (refining gained {gain:.3f})"
    return refined, f"guess refined (gained {gain:.3f})"


def _lowest(vertices: np.ndarray, placed: ScaledPose) -> float:
    return float(placed.apply(vertices)[:, 2].min())


def _rested(model: ModelView, vertices: np.ndarray, placed: ScaledPose, options: IcpOptions) -> tuple[ScaledPose, str]:
    """Move a body that nearly touches the support onto it, unless the view contradicts."""
    lowest = _lowest(vertices, placed)
    if abs(lowest) > options.rest_m:
        return placed, f", stands {lowest * 1000:.0f} mm above the support"
    if abs(lowest) < 1e-4:
        return placed, ""
    moved = replace(placed, pose=transforms.rigid(np.eye(3), np.array([0.0, 0.0, -lowest])) @ placed.pose)
    if model.score(moved).cost > model.score(placed).cost + 0.05:
        return placed, f", seen {lowest * 1000:.0f} mm above the support"
    return moved, f", set down by {lowest * 1000:.1f} mm"


def _result(
    model: ModelView, vertices: np.ndarray, points: np.ndarray, placed: ScaledPose, method: str, *, ambiguous: bool
) -> Placed:
    distances = np.sort(model.distances(placed, points))
    score = model.score(placed)
    placement = Placement(
        pose=Pose(parent="world", child="object", matrix=placed.pose),
        scale=placed.scale,
        residual_m=float(distances[: max(1, int(0.9 * len(distances)))].mean()),
        overlap=float((distances <= 0.005).mean()),
        method=method,
        ambiguous=ambiguous,
    )
    return Placed(placement, score.iou, score.violation, _lowest(vertices, placed))


def _with_spread(
    placement: Placement,
    model: ModelView,
    vertices: np.ndarray,
    placed: ScaledPose,
    seen: Seen,
    of_shape: np.ndarray | None,
    options: IcpOptions,
) -> Placement:
    """The placement with the summed covariances of the registration, of the shape's own frame and of the support."""
    freedom = lie.FREE
    if placed.pose[2, 2] > _VERTICAL:
        standing = abs(_lowest(vertices, placed)) < 1e-3
        freedom = lie.resting(float(placed.pose[2, 3])) if standing else lie.UPRIGHT
    size = placed.scale * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    found = spread.covariance(model, placed, size, options.start_scale_sigma, freedom)
    covariance = found[:6, :6] if of_shape is None else found[:6, :6] + of_shape
    placement = placement.model_copy(update={"scale_sigma": float(np.sqrt(found[6, 6]))})
    return _summed(placement, covariance, placed, seen)


def _summed(placement: Placement, covariance: np.ndarray, placed: ScaledPose, seen: Seen) -> Placement:
    """The placement with the covariance (6, 6) of its own pose and that of the support."""
    of_support = seen.measured.camera_pose.covariance
    summed = covariance.copy()
    if of_support is not None:
        summed += spread.by_support(of_support, seen.world_from_camera, placed.pose)
    if placement.ambiguous and placed.pose[2, 2] > _VERTICAL:
        summed[5, 5] = max(summed[5, 5], spread.ANY_TURN**2)
    return placement.model_copy(update={"pose": placement.pose.model_copy(update={"covariance": summed})})
