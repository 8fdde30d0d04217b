"""align.support: find the plane under the objects and make it the world's floor."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.camera import Measured, Photograph
from dextera_build.artifacts.object import Support
from dextera_build.artifacts.pose import Pose
from dextera_build.geometry import cameras, planes, regions, transforms
from dextera_build.rule import Context, Options, rule

from .surfaces import Surface, choose, find


class SupportOptions(Options):
    """Options of align.support."""

    farthest_m: PositiveFloat = 4.0
    """Depth beyond this is ignored [m]."""
    warp_m: NonNegativeFloat = 0.002
    """Unevenness of a support in addition to the depth camera's noise, one standard deviation [m]."""
    smallest_m2: NonNegativeFloat = 0.02
    """Minimum visible area of a support [m^2]."""
    surfaces: PositiveInt = 6
    """Number of planes compared."""
    seed: NonNegativeInt = 0
    """Seed of the random sampling."""


@rule(version=2)
def support(
    ctx: Context, photograph: Photograph, measured: Measured | None = None, *, options: SupportOptions | None = None
) -> Support:
    """Return the support plane and the world frame on it: z up along the normal, origin at its centre [m].

    Assumes a roughly upright camera that looks at the support from above.
    """
    options = options or SupportOptions()
    if measured is None:
        ctx.fail("the capture has no depth to find a support in", hint="add `depth.png` to the capture")
    depth = measured.depth.depth
    points = cameras.backproject(depth, photograph.camera.matrix())
    valid = (depth > 0) & (depth <= options.farthest_m)
    if valid.sum() < 1000:
        ctx.fail(
            "too little depth to find a support",
            pixels=f"{int(valid.sum()):,} within {options.farthest_m:g} m",
            hint="capture the table from 0.4 to 2 m, or raise `farthest_m`",
        )
    found = find(points, valid, options.surfaces, options.warp_m, np.random.default_rng(options.seed))
    best = choose(found, options.smallest_m2)
    if best is None:
        ctx.fail(
            "no support plane is in view",
            planes=_listing(found),
            smallest=f"{options.smallest_m2:g} m^2, facing up",
            hint="show more of the table, or lower `smallest_m2`",
        )
    result = _support(best, points, valid)
    area = regions.area(result.polygon)
    ctx.check(result.residual_m < 0.02, "the support is not flat", residual=f"{result.residual_m * 1000:.1f} mm")
    below, rms = result.camera_pose.matrix[2, 3], 1000 * result.residual_m
    ctx.say(f"{area:.2f} m² at {below:.2f} m below the camera, {rms:.1f} mm rms")
    ctx.metric("support residual", result.residual_m * 1000, "mm")
    ctx.metric("support inliers", result.inlier_fraction)
    ctx.preview(_painted(photograph.rgb.pixels, best.region), "support")
    return result


def _support(surface: Surface, points: np.ndarray, valid: np.ndarray) -> Support:
    outline = surface.outline
    middle = surface.lift(regions.centroid(outline))
    world_from_camera = transforms.rigid(surface.axes, -surface.axes @ middle)
    heights = planes.distance(surface.plane, points[surface.region])
    polygon = outline - regions.centroid(outline)
    return Support(
        camera_pose=Pose(parent="world", child="camera", matrix=world_from_camera),
        polygon=np.ascontiguousarray(polygon),
        residual_m=float(np.sqrt(np.mean(np.square(heights)))),
        inlier_fraction=float(surface.region.sum() / valid.sum()),
    )


def _listing(found: list[Surface]) -> str:
    parts = [f"{s.area_m2:.3f} m^2 tilted {np.degrees(s.tilt_rad):.0f} deg" for s in found]
    return ", ".join(parts) if parts else "none"


def _painted(pixels: np.ndarray, region: np.ndarray) -> np.ndarray:
    painted = pixels.copy()
    painted[region] = (0.55 * painted[region] + 0.45 * np.array([40, 190, 90])).astype(np.uint8)
    return painted
