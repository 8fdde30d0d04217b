"""Links and joints stated in `scene.yaml`, where the photograph shows none: a closed door, a shut drawer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Joint, JointHint, Link, Shape
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import kinematics, planes, solids, transforms
from dextera_build.rule import Context

from .. import manifolds
from ..measured import Measurements
from . import sweep
from .parts import Parts

if TYPE_CHECKING:
    from manifold3d import Manifold

LEAST_POINTS = 40
"""Minimum number of measured pixels in `part_px`."""
PANEL_M = 0.02
"""Thickness of a door or a lid whose edge is not visible [m]."""
OUT_M = 0.04
"""Distance in front of its plane within which geometry, such as a handle, belongs to the part [m]."""
DRAWER = 0.85
"""Depth of a drawer, as a fraction of the body's depth."""
WIDEST_TURN = np.radians(110.0)
"""Opening of a hinge without `range` if nothing blocks it [rad]."""
PULLED = 0.8
"""Travel of a drawer without `range`, as a fraction of its depth."""


@dataclass(frozen=True)
class _Front:
    """The flat front of a part, in the object frame."""

    points: np.ndarray  # (N, 3) on it [m]
    normal: np.ndarray  # (3,) unit, towards the camera
    offset: float  # normal . point


def parts(
    ctx: Context, shape: Shape, measured: Measurements[Seen], hints: tuple[JointHint, ...], camera: Camera | None
) -> Parts:
    """Cut the shape at the fronts given by the hints."""
    seen = measured.needed()
    if camera is None or shape.pose is None:
        lack = "the camera of the whole photograph" if camera is None else "the pose of the shape in the world"
        ctx.fail(
            f"stated joints need {lack}",
            hint="give `factorize.articulate` the input `camera: $photo.photograph.camera`, and a backend of "
            "`factorize.mesh` that reads depth",
        )
    # A crop moves the principal point by its left and upper border.
    corner = np.array([camera.cx - seen.camera.cx, camera.cy - seen.camera.cy])
    base = manifolds.solid(shape.mesh)
    moving: list[Manifold] = []
    fronts = []
    for number, hint in enumerate(hints, start=1):
        front = _front(ctx, seen, hint, corner, shape.pose, number)
        mine = base ^ _prism(front, hint, shape)
        base = base - mine
        if mine.is_empty() or base.is_empty():
            ctx.fail(
                f"joint {number} leaves {'no part that moves' if mine.is_empty() else 'nothing that stays'}",
                part_px=list(hint.part_px),
                hint="let `part_px` hold the front of the moving part alone",
            )
        moving.append(mine)
        fronts.append(front)
    links = {"base": Link(mesh=manifolds.mesh(base, shape.mesh))}
    joints = []
    for number, (hint, front, solid) in enumerate(zip(hints, fronts, moving, strict=True), start=1):
        others = [base, *(other for other in moving if other is not solid)]
        joint = _joint(ctx, number, hint, front, (seen, corner, shape.pose), solid, others)
        closed = solid.transform(kinematics.joint_motion(joint, -hint.position)[:3])
        links[joint.child] = Link(mesh=manifolds.mesh(closed, shape.mesh))
        joints.append(joint)
    return Parts(links, tuple(joints))


def _front(ctx: Context, seen: Seen, hint: JointHint, corner: np.ndarray, pose: Pose, number: int) -> _Front:
    left, top, right, bottom = (round(v) for v in np.array(hint.part_px) - np.tile(corner, 2))
    inside = np.zeros(seen.mask.shape, bool)
    inside[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
    chosen = inside & seen.mask & (seen.depth > 0)
    if chosen.sum() < LEAST_POINTS:
        ctx.fail(
            f"`part_px` of joint {number} holds {int(chosen.sum())} measured pixels of the object",
            part_px=list(hint.part_px),
            needed=LEAST_POINTS,
            hint="give the box of the moving part's front, [left, top, right, bottom] in the whole photograph",
        )
    points = seen.camera_points(chosen)
    sigma = planes.depth_sigma(points[:, 2])
    plane = planes.facing(planes.refine(planes.fit(points), points, sigma))
    on = np.abs(planes.distance(plane, points)) < 3.0 * sigma
    to_object = (pose.inverse() @ seen.measured.camera_pose).matrix
    local = transforms.apply(to_object, points[on])
    normal = to_object[:3, :3] @ plane[0]
    return _Front(local, normal, float(np.median(local @ normal)))


def _prism(front: _Front, hint: JointHint, shape: Shape) -> Manifold:
    """The prism in front of and behind the front's outline, with the assumed depth of the part."""
    span = shape.mesh.vertices.astype(np.float64) @ front.normal
    deep = DRAWER * (front.offset - float(span.min())) if hint.type == "prismatic" else PANEL_M
    turn = transforms.rotation_between(np.array([0.0, 0.0, 1.0]), front.normal)
    flat = front.points @ turn
    low, high = np.quantile(flat[:, :2], 0.005, axis=0), np.quantile(flat[:, :2], 0.995, axis=0)
    inside = flat[((flat[:, :2] >= low) & (flat[:, :2] <= high)).all(axis=1), :2]
    outline = _hull(inside)
    solid = solids.extrude(outline, front.offset - deep, front.offset + OUT_M)
    return solids.manifold((solid.vertices @ turn.T).astype(np.float32), solid.faces)


def _hull(points: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    return np.asarray(points[ConvexHull(points).vertices])


def _joint(
    ctx: Context,
    number: int,
    hint: JointHint,
    front: _Front,
    view: tuple[Seen, np.ndarray, Pose],
    solid: Manifold,
    others: list[Manifold],
) -> Joint:
    turns = hint.type == "revolute"
    if hint.axis_px is not None:
        ends = [_on_front(np.array(pixel), front, *view) for pixel in hint.axis_px]
        origin, axis = ends[0], ends[1] - ends[0]
    elif turns:
        ctx.fail(f"joint {number} is a hinge without `axis_px`", hint="give two pixels on its hinge")
    else:
        origin, axis = front.points.mean(axis=0), front.normal
    axis = axis / np.linalg.norm(axis)
    joint = Joint(
        name=f"{'hinge' if turns else 'slide'}_{number}",
        type=hint.type,
        parent="base",
        child=f"part_{number}",
        origin=tuple(origin.tolist()),
        axis=tuple(axis.tolist()),
        lower=0.0,
        upper=0.0,
        position=hint.position,
    )
    if hint.range is not None:
        return joint.model_copy(update={"lower": hint.range[0], "upper": hint.range[1]})
    deep = -np.ptp((np.reshape(solid.bounding_box(), (2, 3))) @ axis) * PULLED
    reach = WIDEST_TURN if turns else abs(deep)
    top, stopped = sweep.free(
        solid, others, lambda change: kinematics.joint_motion(joint, change), hint.position, hint.position + reach
    )
    return joint.model_copy(
        update={
            "lower": min(0.0, hint.position),
            "upper": top,
            "upper_range": (hint.position, top) if stopped else None,
        }
    )


def _on_front(pixel: np.ndarray, front: _Front, seen: Seen, corner: np.ndarray, pose: Pose) -> np.ndarray:
    """Point on the front's plane at a pixel of the whole photograph, object frame (3,)."""
    to_object = (pose.inverse() @ seen.measured.camera_pose).matrix
    u, v = pixel - corner
    ray = to_object[:3, :3] @ np.array(
        [(u - seen.camera.cx) / seen.camera.fx, (v - seen.camera.cy) / seen.camera.fy, 1]
    )
    eye = to_object[:3, 3]
    return np.asarray(eye + ray * ((front.offset - front.normal @ eye) / (front.normal @ ray)))
