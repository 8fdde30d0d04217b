"""align.support: find the plane under the objects and make it the world's floor."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.camera import Camera, Measured, Photograph
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, planes, regions, transforms, upright
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from . import uneven, unmeasured
from .surfaces import Surface, carries, choose, find, quarter_turns
from .unmeasured import MarkerOptions

SIDES = ("top", "right", "bottom", "left")
"""Side of the picture that is up, by the counter-clockwise quarter turns that make it upright."""


class SupportOptions(Options):
    """Options of align.support."""

    farthest_m: PositiveFloat = 4.0
    """Depth beyond this is ignored [m]."""
    warp_m: NonNegativeFloat = 0.002
    """Unevenness of the support, one standard deviation, in addition to the depth camera's noise [m]."""
    smallest_m2: NonNegativeFloat = 0.02
    """Minimum visible area of a support [m^2]."""
    surfaces: PositiveInt = 6
    """Number of candidate planes."""
    up: Literal["auto", "top", "right", "bottom", "left"] = "auto"
    """Side of the picture that is up; `auto` uses the top, unless the depth shows a support only in a rotated
    picture."""
    seed: NonNegativeInt = 0
    """Seed of the random sampling."""
    marker: MarkerOptions | None = None
    """A marker on the support, for photographs without depth."""
    base_above_m: float = 0.0
    """Height of the robot's base above the support [m], for photographs without depth."""
    pitch_deg: float = Field(35.0, gt=0.0, le=90.0)
    """Pitch of the camera below the horizontal, assumed for photographs without depth, marker and robot [deg]."""
    reach: PositiveFloat = 3.0
    """Extent of an unmeasured support, in heights of the camera above it."""


@rule(version=5, tolerance=Tolerance({"": ROUNDING}))
def support(
    ctx: Context,
    photograph: Photograph,
    measured: Measured | None = None,
    robot: Pose | None = None,
    *,
    options: SupportOptions | None = None,
) -> Support:
    """Return the support plane and the world frame on it: z up along the normal, origin at its centre [m].

    The camera looks at the support from above, in any orientation about its axis, see `up`. Without depth, the plane
    comes from a marker, from the robot's pose T_camera_base, or from an assumed pitch; the scale is unknown in the last
    case.
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
    turns, found, points = _found(photograph.camera, depth, valid, options)
    best = choose(found, options.smallest_m2)
    if best is None:
        ctx.fail(
            "no support plane is in view",
            planes=_listing(found),
            smallest=f"{options.smallest_m2:g} m^2, facing up",
            hint="show more of the table, lower `smallest_m2`, or set `up` to the upper side of the picture",
        )
    level = _support(best, points, upright.turned(valid, turns))
    if doubt := uneven.doubt(level, points, upright.turned(valid, turns)):
        ctx.warn(doubt)
    result = _seen_from(level, turns)
    area = regions.area(result.polygon)
    below, rms = result.camera_pose.matrix[2, 3], 1000 * (result.residual_m or 0.0)
    ctx.check(rms < 20.0, "the support is not flat", residual=f"{rms:.1f} mm")
    ctx.say(f"{area:.2f} m² at {below:.2f} m below the camera, {rms:.1f} mm rms")
    ctx.metric("support residual", rms, "mm")
    ctx.metric("support inliers", result.inlier_fraction or 0.0)
    ctx.preview(_painted(photograph.rgb.pixels, upright.turned(best.region, -turns)), "support")
    if turns and options.up == "auto":
        ctx.warn(f"the camera was turned: up is taken to be the {SIDES[turns]} of the picture; set `up` if it is not")
    return result


def _found(
    camera: Camera, depth: np.ndarray, valid: np.ndarray, options: SupportOptions
) -> tuple[int, list[Surface], np.ndarray]:
    """Quarter turns that make the picture upright, and the surfaces and points (H, W, 3) of the upright picture."""

    def look(count: int) -> tuple[list[Surface], np.ndarray]:
        points = cameras.backproject(upright.turned(depth, count), camera.turned(count).matrix())
        rng = np.random.default_rng(options.seed)
        return find(points, upright.turned(valid, count), options.surfaces, options.warp_m, rng), points

    turns = 0 if options.up == "auto" else SIDES.index(options.up)
    found, points = look(turns)
    count = quarter_turns(found, options.smallest_m2) if options.up == "auto" else 0
    if count:
        again, seen = look(count)
        best = choose(again, options.smallest_m2)
        # A bare wall seen from slightly above resembles a bare table seen by an upside-down camera.
        if best is not None and carries(best, seen, upright.turned(valid, count)):
            return count, again, seen
    return turns, found, points


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
    else:
        plane = unmeasured.assumed(options.pitch_deg, turns)
    result = unmeasured.support(ctx, photograph, plane, options.reach, turns)
    below = result.camera_pose.matrix[2, 3]
    if plane.scale == "unknown":
        ctx.say(f"assumed: the camera looks down by {options.pitch_deg:g} deg; scale unknown")
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


def _listing(found: list[Surface]) -> str:
    parts = [f"{s.area_m2:.3f} m^2 tilted {np.degrees(s.tilt_rad):.0f} deg" for s in found]
    return ", ".join(parts) if parts else "none"


def _painted(pixels: np.ndarray, region: np.ndarray) -> np.ndarray:
    painted = pixels.copy()
    painted[region] = (0.55 * painted[region] + 0.45 * np.array([40, 190, 90])).astype(np.uint8)
    return painted
