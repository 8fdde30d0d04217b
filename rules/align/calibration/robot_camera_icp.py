"""Backend `icp` of align.robot_camera: the model's visible surface by ray casting, registered over all poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import balanced_icp, cameras, lie, robot_mask, robot_surfaces, transforms, uncertainty
from dextera_build.geometry.robot_covariance import Doubts
from dextera_build.geometry.robot_pairs import Surface
from dextera_build.rule import Backend, Context, Options

from . import robot_overlays, stated
from .robot_camera import Refinement

if TYPE_CHECKING:
    from dextera_build.sim.render.robot_view import RobotRenderer, RobotView

    from .robot_camera import RobotCameraOptions

BACKEND = Backend(
    summary="balanced ICP on the robot's visible surface, by ray casting",
    profiles=("cpu",),
    packages=("open3d", "mujoco", "scipy"),
    extra="twin",
)
WIDEST_PX = 640
"""Pictures are subsampled to at most this width [px]."""
PARTS = ("arm", "hand")
OUTER_M = 0.012
"""Minimum depth gate in the last rounds [m]; remaining outliers are trimmed."""


def refine(
    ctx: Context,
    views: RobotViews,
    robot: RobotModel,
    camera_base: np.ndarray,
    common: RobotCameraOptions,
    options: Options,
) -> Refinement:
    """The accumulated correction of all rounds."""
    from dextera_build.sim.render.robot_view import RobotRenderer

    assert views.joints is not None
    stated.check_joints(ctx, views.joints, robot)
    first = next(iter(views.captures.values()))
    every = max(1, -(-first.photograph.camera.width // WIDEST_PX))
    renderer = RobotRenderer(robot, sampled(first.photograph.camera, every))
    doubts = Doubts(np.radians(common.joint_sigma_deg), np.radians(common.encoder_sigma_deg), common.surface_sigma_m)
    now, found, overlap = camera_base, None, np.zeros(len(views.captures))
    covariance, offsets, cost = 1e6 * np.eye(6), dict[str, float](), None
    for number in range(common.rounds):
        tolerance = max(common.tolerance_m / 2**number, OUTER_M)
        grow = max(1, round(common.grow_px / every / 2**number))
        poses, overlap = _surfaces(views, renderer, now, every, tolerance, grow)
        ctx.progress(number + 1, common.rounds, "rounds")
        if overlap.max() < common.least_overlap:
            break
        try:
            found = balanced_icp.correct(poses, points=common.points, balanced=common.balanced, doubts=doubts)
        except ValueError as error:
            ctx.fail(
                f"arm and hand are not both seen: {error}", hint="take pictures with depth on both, see `least_overlap`"
            )
        motion, spread = found.motion, found.covariance
        if number == common.rounds - 1 and common.balanced and not common.exact_model:
            own = robot_surfaces.register(poses, motion, points=common.points, doubts=doubts)
            motion, spread, offsets, cost = own.motion, own.covariance, dict(own.offsets), own.spread
        # Eq. 3: dT is multiplied from the left, in the camera frame.
        covariance = uncertainty.compose(motion, now, (spread, np.zeros((6, 6))))
        now = motion @ now
        if cost is not None:
            about = lie.adjoint(motion[:3, 3] - now[:3, 3])
            cost = about.T @ cost @ about
    residuals = {} if found is None else {name: found.residuals[name] for name in PARTS if name in found.residuals}
    robot_overlays.preview(ctx, views, renderer, now, every, residuals)
    shift = _shift(renderer, views, camera_base, now)
    return Refinement(now, covariance, residuals, overlap, shift, offsets, cost)


def sampled(camera: Camera, every: int) -> Camera:
    """The camera of every `every`-th pixel of its rows and columns, the first included."""
    return Camera(
        width=-(-camera.width // every),
        height=-(-camera.height // every),
        fx=camera.fx / every,
        fy=camera.fy / every,
        cx=camera.cx / every,
        cy=camera.cy / every,
    )


def _surfaces(
    views: RobotViews, renderer: RobotRenderer, camera_base: np.ndarray, every: int, tolerance: float, grow: int
) -> tuple[list[dict[str, Surface]], np.ndarray]:
    """Model and measured points of every pose, and the fraction of the rendered robot with measured depth."""
    assert views.joints is not None
    poses, overlap = [], []
    for row, capture in zip(views.joints.positions, views.captures.values(), strict=True):
        seen = renderer.view(dict(zip(views.joints.names, row.tolist(), strict=True)), camera_base)
        measured = depth_of(capture, every)
        labels = robot_mask.near(seen.depth, seen.labels, measured, tolerance, grow)
        agreeing = (seen.labels > 0) & (labels > 0)
        overlap.append(float(agreeing.sum() / max((seen.labels > 0).sum(), 1)))
        hidden = (measured > 0) & (measured < seen.depth - tolerance)
        poses.append(_parts(renderer, seen, labels, measured, camera_base, hidden))
    return poses, np.array(overlap)


def _parts(
    renderer: RobotRenderer,
    seen: RobotView,
    labels: np.ndarray,
    measured: np.ndarray,
    camera_base: np.ndarray,
    hidden: np.ndarray,
) -> dict[str, Surface]:
    """Arm and hand of one pose; the model is not visible at pixels of occluders, `hidden`."""
    k = renderer.camera.matrix()
    points = cameras.backproject(measured, k)
    inner = robot_mask.inner(seen.labels, seen.depth) & ~hidden
    flat = robot_mask.inner(labels, np.where(labels > 0, measured, 0.0), step=0.02)
    found = {}
    for number, name in enumerate(PARTS, start=1):
        model, real = inner & (seen.labels == number), flat & (labels == number)
        if model.sum() < 20 or real.sum() < 20:
            continue
        link = seen.link[model]
        drift = renderer.drift(seen.points[model], link, camera_base)
        found[name] = Surface(seen.points[model], seen.normals[model], link, points[real], drift)
    return found


def depth_of(capture: Capture, every: int) -> np.ndarray:
    """Depth (H, W) float64 of every `every`-th pixel [m]."""
    assert capture.measured is not None
    return capture.measured.depth.depth[::every, ::every].astype(np.float64)


def _shift(renderer: RobotRenderer, views: RobotViews, before: np.ndarray, after: np.ndarray) -> float:
    """Root mean square motion of the robot's visible points in the first pose [m]."""
    assert views.joints is not None
    joints = dict(zip(views.joints.names, views.joints.positions[0].tolist(), strict=True))
    seen = renderer.view(joints, before)
    points = seen.points[seen.labels > 0]
    moved = transforms.apply(after @ transforms.invert(before), points)
    return float(np.sqrt(((moved - points) ** 2).sum(axis=1).mean())) if len(points) else 0.0
