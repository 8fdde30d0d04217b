"""align.support: find the plane under the objects and make it the world's floor."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import pictures, planes, regions, transforms, upright
from dextera_build.rule import ROUNDING, Context, Tolerance, rule

from . import uneven, unmeasured
from .candidates import SIDES, Candidates, known_up, likely_up, of_depth
from .support_options import SupportOptions
from .surfaces import Surface


@rule(version=7, packages=("numpy", "opencv-python-headless"), tolerance=Tolerance({"": ROUNDING}))
def support(
    ctx: Context,
    photograph: Photograph,
    measured: Measured | None = None,
    robot: Pose | None = None,
    *,
    options: SupportOptions | None = None,
) -> Support:
    """Return the support plane and the world frame on it: z up along the normal, origin at its centre [m].

    The camera looks at the support from above, in any orientation about its axis, see `up`. Of several level surfaces,
    one on which things stand is chosen; `photograph.gravity`, or the z axis of the robot's base (T_camera_base), tells
    what is level; without them, a surface that upright lines in the picture contradict has less weight. If another
    surface may be the support as well, a warning and a picture show both. Without depth, the plane comes from a marker,
    from the robot's pose T_camera_base, from upright lines, or from an assumed pitch; the scale is unknown in the last
    two cases.
    """
    options = options or SupportOptions()
    if measured is None:
        return _unmeasured(ctx, photograph, robot, options)
    depth = measured.depth.depth
    valid = (depth > 0) & (depth <= options.farthest_m)
    if valid.sum() < 1000:
        ctx.fail(
            "too little depth to find a support",
            pixels=f"{int(valid.sum()):,} within {options.farthest_m:g} m",
            hint="capture the table from 0.4 to 2 m, or raise `farthest_m`",
        )
    seen = of_depth(ctx, photograph, depth, valid, known_up(photograph, robot), options)
    best, turns, points = seen.best, seen.turns, seen.points
    level = _support(best, points, upright.turned(valid, turns))
    if doubt := uneven.doubt(level, points, upright.turned(valid, turns)):
        ctx.warn(doubt)
    result = _seen_from(level, turns)
    area = regions.area(result.polygon)
    below, rms = result.camera_pose.matrix[2, 3], 1000 * (result.residual_m or 0.0)
    ctx.check(rms < 20.0, "the support is not flat", residual=f"{rms:.1f} mm")
    ctx.say(f"{area:.2f} m² at {below:.2f} m below the camera, {rms:.1f} mm rms")
    if seen.likely is not None:
        cosine = float(np.clip(seen.best.plane[0] @ seen.likely, -1.0, 1.0))
        ctx.metric("upright lines", np.degrees(np.arccos(cosine)), "deg from the support's normal")
    ctx.metric("support residual", rms, "mm")
    ctx.metric("support inliers", result.inlier_fraction or 0.0)
    _show(ctx, photograph.rgb.pixels, seen)
    if turns and options.up == "auto":
        ctx.warn(f"the camera was turned: up is taken to be the {SIDES[turns]} of the picture; set `up` if it is not")
    return result


def _seen_from(support: Support, turns: int) -> Support:
    """The support of the upright picture, expressed for the original camera."""
    pose = support.camera_pose
    matrix = pose.matrix @ upright.turned_from_camera(turns)
    return support.model_copy(update={"camera_pose": pose.model_copy(update={"matrix": matrix})})


def _unmeasured(ctx: Context, photograph: Photograph, robot: Pose | None, options: SupportOptions) -> Support:
    turns = 0 if options.up == "auto" else SIDES.index(options.up)
    if options.marker is not None:
        plane = unmeasured.marked(ctx, photograph, options.marker)
    elif robot is not None:
        frames = (robot.parent, robot.child)
        ctx.check(frames == ("camera", "base"), f"`robot` is T_{frames[0]}_{frames[1]}, but T_camera_base is needed")
        plane = unmeasured.under_robot(robot, options.base_above_m)
    elif photograph.gravity is not None:
        plane = unmeasured.level(-np.array(photograph.gravity), "gravity", unmeasured.GRAVITY_RAD)
    elif options.pitch_deg is not None:
        plane = unmeasured.looking_down(options.pitch_deg, turns, "stated", unmeasured.STATED_RAD)
    elif (lines := likely_up(photograph, options)) is not None:
        plane = unmeasured.level(lines.direction, "by upright lines", unmeasured.LINES_RAD)
    else:
        plane = unmeasured.looking_down(unmeasured.PITCH_DEG, turns, "assumed", unmeasured.PITCH_RAD)
    result = unmeasured.support(ctx, photograph, plane, options.reach, turns)
    below = result.camera_pose.matrix[2, 3]
    if plane.scale == "unknown":
        pitch = np.degrees(np.arcsin(-plane.normal[2]))
        ctx.say(f"{plane.source}: the camera looks down by {pitch:.3g} deg; scale unknown")
    else:
        ctx.say(f"{below:.3f} m below the camera, by the {plane.scale}")
    return result


INDEPENDENT = 40.0
"""Effective number of independent depths of a support; errors of neighbours are correlated."""


def _support(surface: Surface, points: np.ndarray, valid: np.ndarray) -> Support:
    outline = surface.outline
    middle = surface.lift(regions.centroid(outline))
    world_from_camera = transforms.rigid(surface.axes, -surface.axes @ middle)
    on_plane = points[surface.region]
    heights = planes.distance(surface.plane, on_plane)
    residual = float(np.sqrt(np.mean(np.square(heights))))
    noise = max(residual, float(planes.depth_sigma(np.median(on_plane[:, 2]))))
    covariance = _covariance(transforms.apply(world_from_camera, on_plane), noise, world_from_camera[:3, 3])
    polygon = outline - regions.centroid(outline)
    return Support(
        camera_pose=Pose(parent="world", child="camera", matrix=world_from_camera, covariance=covariance),
        polygon=np.ascontiguousarray(polygon),
        residual_m=residual,
        inlier_fraction=float(surface.region.sum() / valid.sum()),
    )


def _covariance(points: np.ndarray, noise: float, camera: np.ndarray) -> np.ndarray:
    """Covariance (6, 6) of T_world_camera from the plane's height and tilt; the other axes only define the world.

    Args:
        points: (N, 3) of the plane in the world [m].
        noise: Standard deviation of their heights [m].
        camera: (3,) the camera's position in the world [m].
    """
    design = np.column_stack([np.ones(len(points)), points[:, :2]])
    of_plane = noise**2 / INDEPENDENT * np.linalg.pinv(design.T @ design / len(points))
    # A plane z = e + a x + b y is levelled by the rotation (-b, a, 0) and the shift -e.
    slopes = np.zeros((6, 3))
    slopes[3:6, 1:] = [[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]]
    slopes[:3] = -transforms.cross_matrix(camera) @ slopes[3:6]
    slopes[2, 0] = -1.0
    covariance = slopes @ of_plane @ slopes.T
    return np.asarray((covariance + covariance.T) / 2)


CHOSEN, OTHER = (40, 190, 90), (240, 140, 30)
"""Colours of the support and of another surface that may be it."""


def _show(ctx: Context, pixels: np.ndarray, seen: Candidates) -> None:
    """A picture of the support, and a warning if another surface may be it."""
    painted = _painted(pixels, upright.turned(seen.best.region, -seen.turns), CHOSEN)
    if seen.rival is None:
        ctx.preview(painted, "support")
        return
    region = upright.turned(seen.rival.region, -seen.turns)
    column, row = pictures.innermost(region)
    ctx.preview(_painted(painted, region, OTHER), "support (green), and another surface that may be it (orange)")
    ctx.warn(
        f"two surfaces may be the support: {seen.best.area_m2:.2f} m² at {seen.best.plane[1]:.2f} m from the camera is "
        f"taken, and things also stand on {seen.rival.area_m2:.2f} m² at {seen.rival.plane[1]:.2f} m, orange in the "
        f"picture; `support: {{at_px: [{column}, {row}]}}` in the recipe chooses that one"
    )


def _painted(pixels: np.ndarray, region: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    painted = pixels.copy()
    painted[region] = (0.55 * painted[region] + 0.45 * np.array(colour)).astype(np.uint8)
    return painted
