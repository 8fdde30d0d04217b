"""Closed meshes from a photograph without depth: boxes, cylinders and revolved bodies fitted to the outline."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import silhouettes
from .evidence import gather
from .fitted import Fitted, best_of, fitted_of
from .refine import descend

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="a box, cylinder, revolved body or vessel on the support, fitted to the outline; needs no depth",
    packages=("manifold3d", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)
COMMON = 3.0
"""Factor of a fit's standard deviations: masks cut from the picture alone err along whole sides, not by pixel."""
STARTS = 4
"""Number of initial guesses that are refined."""
WIDE_M = 0.1
"""Width of a thing of which nothing tells the scale, for walls and other lengths that the outline does not show [m]."""


class SilhouetteOptions(Options):
    """Options of backend `silhouette` of factorize.mesh."""

    wall_m: PositiveFloat = 0.003
    """Wall thickness of a vessel [m]; the photograph does not show it."""
    vessels: tuple[str, ...] = ("basket", "bowl", "cup", "glass", "mug", "pot", "tumbler", "vase")
    """Words of a phrase that make a body a vessel, which is open at the top; the outline does not show the cavity."""
    refine_steps: NonNegativeInt = 14
    """Maximum least-squares steps per hypothesis; the best one gets three times as many."""


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: SilhouetteOptions
) -> Shape:
    """Return the closed, textured body that stands on the support and has the outline of the mask.

    Args:
        ctx: The rule's context.
        view: The view.
        measured: The pose of the camera over the support; depth is not read.
        common: The rule's options.
        options: The backend's.
    """
    if measured.unmeasured is None:
        ctx.fail(
            "the camera's pose over the support is not given, so the outline tells no size",
            hint="give the input `support`, a result of `align.support`",
        )
    seen = measured.unmeasured.upright()
    at = silhouettes.frame(gather(seen))
    if at is None:
        ctx.fail(
            "the lowest point of the mask is not on the support: the camera sees it level with the horizon or above",
            mask=f"{int(view.mask.sum()):,} pixels",
            hint="check the support's marker or `pitch_deg`, or the element's box",
        )
    unit = 1.0 if measured.metric else WIDE_M / at.width
    shape = _fitted(ctx, _nearer(seen, unit), common, options)
    return shape if measured.metric else _larger(shape, 1.0 / unit)


def _nearer(seen: Seen, unit: float) -> Seen:
    """The view by a camera whose distances are those of this one times `unit`."""
    pose = _scaled(seen.measured.camera_pose, unit)
    return replace(seen, measured=seen.measured.model_copy(update={"camera_pose": pose}))


def _larger(shape: Shape, unit: float) -> Shape:
    """The shape and its place with all lengths times `unit`."""
    sized = similar.scaled(unit)
    assert shape.pose is not None
    return shape.model_copy(
        update={
            "mesh": similar.mesh(shape.mesh, sized),
            "walls": tuple(similar.hull(wall, sized) for wall in shape.walls),
            "pose": _scaled(shape.pose, unit),
        }
    )


def _scaled(pose: Pose, unit: float) -> Pose:
    """The pose with its lengths, and their standard deviations, times `unit`."""
    matrix, lengths = pose.matrix.copy(), np.array([unit, unit, unit, 1.0, 1.0, 1.0])
    matrix[:3, 3] *= unit
    covariance = None if pose.covariance is None else pose.covariance * np.outer(lengths, lengths)
    return pose.model_copy(update={"matrix": matrix, "covariance": covariance})


def _fitted(ctx: Context, seen: Seen, common: MeshOptions, options: SilhouetteOptions) -> Shape:
    """The shape that explains the outline best, in metres."""
    view, evidence = seen.view, gather(seen)
    at = silhouettes.frame(evidence)
    assert at is not None
    hollow = bool(set(view.phrase.lower().split()) & set(options.vessels))
    round_part, body = evidence, seen
    if hollow:
        mask = silhouettes.symmetric(evidence, at)
        body = replace(seen, view=seen.view.model_copy(update={"mask": mask}))
        round_part = gather(body)
        at = silhouettes.frame(round_part) or at
    fitted = []
    bodies = silhouettes.candidates(round_part, at, options.wall_m, hollow=hollow)
    for done, candidate in enumerate(bodies):
        ctx.progress(done, len(bodies), candidate.model.name)
        fitted.append(fitted_of(candidate, round_part, options.refine_steps, STARTS))
    shape = best_of(fitted, round_part, seen, common, options.refine_steps, evidence)
    best = max(fitted, key=lambda found: found.score)
    size, volume = _by_camera(best, body, options.refine_steps)
    assert shape.pose is not None
    assert shape.pose.covariance is not None
    return shape.model_copy(
        update={
            "pose": shape.pose.model_copy(update={"covariance": COMMON**2 * shape.pose.covariance}),
            "size_sigma": float(np.hypot(COMMON * (shape.size_sigma or 0.0), size)),
            "volume_sigma": float(np.hypot(COMMON * (shape.volume_sigma or 0.0), volume)),
        }
    )


def _by_camera(best: Fitted, seen: Seen, steps: int) -> tuple[float, float]:
    """Standard deviations of the logs of size and volume from that of the camera's pose over the support."""
    covariance = seen.measured.camera_pose.covariance
    if covariance is None:
        return 0.0, 0.0
    values, axes = np.linalg.eigh(covariance)
    changes: list[np.ndarray] = []
    for value, axis in zip(values, axes.T, strict=True):
        if value > 1e-12:
            pose = lie.retract(seen.world_from_camera, np.sqrt(value) * axis)
            moved = gather(replace(seen, measured=seen.measured.model_copy(update={"camera_pose": _at(seen, pose)})))
            again = descend(best.candidate.model, moved, best.parameters, steps)
            changes.append(_logs(best, again.parameters) - _logs(best, best.parameters))
    size, volume = np.sqrt(np.square(changes).sum(axis=0)) if changes else np.zeros(2)
    return float(size), float(volume)


def _at(seen: Seen, matrix: np.ndarray) -> Pose:
    return seen.measured.camera_pose.model_copy(update={"matrix": matrix})


def _logs(best: Fitted, parameters: np.ndarray) -> np.ndarray:
    """Logs of the diagonal [m] and of the volume [m^3], (2,)."""
    solid = best.candidate.model.build(parameters)
    return np.log([float(np.linalg.norm(np.ptp(solid.vertices, axis=0))), max(solid.volume, 1e-12)])
