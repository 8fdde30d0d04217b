"""Warnings about captures that are valid but implausible."""

from __future__ import annotations

import math

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import planes
from dextera_build.rule import Context

from .registered import shift

NARROW_DEG, WIDE_DEG = 32.0, 110.0
"""Range of horizontal fields of view of cameras that photograph tables: Kinect 57, RealSense 55 to 90, phones 60 to
105."""
SQUARE = 0.05
"""Largest relative difference of fx and fy; pixels of cameras are square."""
OFF_CENTRE = 0.2
"""Largest distance of the principal point from the centre, in image sizes."""
NEAR_M, FAR_M = 0.2, 3.0
"""Range of median depths of photographs of tables [m]."""
GAPS = 0.1
"""Largest fraction of the measured area in gaps; real captures had up to 0.04."""
COARSE_M = 0.002
"""Depth quantisation above which bodies become staircases; real captures had 0.1 to 1 mm [m]."""


def of_camera(ctx: Context, camera: Camera) -> None:
    """Warn of unusual intrinsics."""
    if abs(camera.fx / camera.fy - 1.0) > SQUARE:
        ctx.warn(
            f"fx {camera.fx:g} and fy {camera.fy:g} px differ by {abs(camera.fx / camera.fy - 1):.0%}, but pixels are "
            "square: one of them is of another resolution, and widths or heights will be wrong"
        )
    view = 2 * math.degrees(math.atan(camera.width / (2 * camera.fx)))
    if not NARROW_DEG <= view <= WIDE_DEG:
        ctx.warn(
            f"fx {camera.fx:g} px is a field of view of {view:.0f} deg at a width of {camera.width} px: intrinsics of "
            "another resolution make everything too small or too large"
        )
    off = (
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    if max(off) > OFF_CENTRE:
        ctx.warn(
            f"the principal point {camera.cx:g}, {camera.cy:g} px is far from the middle of {camera.width} x "
            f"{camera.height} px: was the picture cropped or resized after calibration?"
        )


def of_depth(ctx: Context, depth: np.ndarray, source: str) -> None:
    """Warn of depths that are implausible for photographs of tables; `source` states where the unit comes from."""
    middle = float(np.median(depth[depth > 0]))
    if not NEAR_M <= middle <= FAR_M:
        large = "large" if middle > FAR_M else "small"
        ctx.warn(
            f"the median depth is {middle:.2f} m, but tables are photographed from {NEAR_M:g} to {FAR_M:g} m: {source} "
            f"may be too {large}, e.g. by a factor of 10"
        )


def of_gaps(ctx: Context, depth: np.ndarray) -> None:
    """Warn of gaps inside the depth; without SciPy, which light installations lack, nothing is checked."""
    try:
        from scipy import ndimage
    except ModuleNotFoundError:
        return

    valid = depth[::2, ::2] > 0
    around = ndimage.binary_fill_holes(ndimage.binary_closing(valid, iterations=2))
    share = float((around & ~valid).sum() / max(1, around.sum()))
    if share > GAPS:
        ctx.warn(
            f"{share:.0%} of the depth is missing amid measured pixels: shapes are uncertain and vessels may look "
            "solid; avoid sun, shiny and clear things, or average several depth images"
        )


def of_steps(ctx: Context, counts: np.ndarray, scale: float, name: str, bits: int) -> None:
    """Warn of depths (H, W) in coarse steps, such as an 8 bit image, even if it was rewritten with 16 bit."""
    known = np.unique(counts)
    step = scale * float(np.diff(known).min()) if len(known) > 1 else 0.0
    if bits == 8:
        ctx.warn(f"`{name}` has 8 bit, so its depths are steps of {1000 * scale:.3g} mm: write it with 16 bit")
    elif step > COARSE_M:
        ctx.warn(
            f"the {len(known)} depths in `{name}` are steps of {1000 * step:.3g} mm: was it reduced to 8 bit? "
            "Write the counts that the camera gives"
        )


def of_noise(ctx: Context, depth: np.ndarray) -> None:
    """Warn of depth that consists mostly of noise."""
    found = planes.mostly_noise(depth)
    if found is not None:
        noise, middle = found
        ctx.warn(
            f"neighbouring pixels of the depth differ by {1000 * noise:.0f} mm at a median of {middle:.2f} m, which is "
            "noise: are its bytes in the right order, and is it the raw depth?"
        )


def of_registration(ctx: Context, pixels: np.ndarray, depth: np.ndarray) -> None:
    """Warn of depth that is not registered to the photograph; without SciPy nothing is checked."""
    try:
        found = shift(pixels, depth)
    except ModuleNotFoundError:
        return
    if found is not None:
        across = f"{abs(found.right)} px {'right' if found.right > 0 else 'left'}"
        down = f"{abs(found.down)} px {'below' if found.down > 0 else 'above'}"
        ctx.warn(
            f"the edges of the depth lie about {across} and {down} of those of the colours: register the depth to the "
            "colour camera, or objects get wrong outlines and the colours of their surroundings"
        )
