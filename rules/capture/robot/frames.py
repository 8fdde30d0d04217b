"""Pictures, depth and gravity of a recording at chosen times, as captures."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.cameras.lens import Equirectangular
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.formats import mcap
from dextera_build.geometry import transforms
from dextera_build.geometry.depth_to_colour import registered
from dextera_build.rule import Context

from .. import doubts
from ..pinhole import Lens, nearest, pinhole, places, smooth
from ..taken import DepthOptions, check_depth
from . import falling
from .topics import CameraTopics, beside

TOGETHER_S = 0.05
"""Largest time between a picture and its depth while the robot is at rest [s]."""
SAME = 0.01
"""Largest relative difference of focal lengths at which depth is registered."""
UNITS = "/option/Depth_Units/value"
"""Suffix of the topic on which RealSense cameras publish metres per count."""


def at(
    ctx: Context, stream: Stream, topics: CameraTopics, stamps: np.ndarray, options: DepthOptions, label: str
) -> dict[str, Capture]:
    """Name -> capture at each of the increasing times (K,) [s] of pictures."""
    lens = _lens(ctx, stream, topics.lens)
    camera = lens if isinstance(lens, Camera) else pinhole(lens)
    doubts.of_camera(ctx, camera)
    pictures = _chosen(mcap.pictures(stream, topics.image), stamps, 1e-6)
    depths = _depths(ctx, stream, topics, lens, stamps) if topics.depth else {}
    # The pictures of a calibration without depth need no gravity, and most are taken while the camera moves.
    down = falling.at(ctx, stream, topics, stamps) if depths or len(stamps) == 1 else {}
    where = None if isinstance(lens, Camera) else places(lens)
    found: dict[str, Capture] = {}
    for number, stamp in enumerate(stamps):
        pixels, depth = pictures[number], depths.get(number)
        _check_size(ctx, pixels.shape[:2], camera, topics.image, topics.lens)
        if depth is not None:
            _check_size(ctx, depth.shape, camera, topics.depth, topics.lens)
            check_depth(ctx, depth, topics.depth, options, stream=True)
        if where is not None:
            pixels, depth = smooth(pixels, where), None if depth is None else nearest(depth, where)
        measured = None if depth is None else Measured(depth=DepthImage(depth=depth))
        photograph = Photograph(rgb=Image(pixels=pixels), camera=camera, gravity=down.get(number))
        found[f"{label}_{number + 1:02d}"] = Capture(photograph=photograph, measured=measured)
        ctx.progress(number + 1, len(stamps), f"pictures, {stamp:.2f} s")
    return found


def _lens(ctx: Context, stream: Stream, topic: str) -> Camera | Lens:
    found = mcap.lens(stream, topic)
    if isinstance(found, Equirectangular):
        ctx.fail(f"`{topic}` is of a panorama", hint="choose the topic of a pinhole or fisheye camera")
    return found


def _depths(
    ctx: Context, stream: Stream, topics: CameraTopics, lens: Camera | Lens, stamps: np.ndarray
) -> dict[int, np.ndarray]:
    """Depth (H, W) [m] by picture number, if taken at about the same time."""
    lenses = [each.topic for each in stream.channels if each.topic.endswith(("camera_info", "calibration"))]
    own = beside(ctx, topics.depth, lenses) if len(lenses) > 1 else topics.lens
    units = [each.topic for each in stream.channels if each.topic.endswith(UNITS)]
    scale = next((value for topic in units if (value := mcap.number(stream, topic)) is not None), 0.001)
    found = _chosen(mcap.depths(stream, topics.depth, scale_m=scale), stamps, TOGETHER_S)
    if len(found) < len(stamps):
        ctx.warn(f"{len(stamps) - len(found)} pictures have no depth within {1000 * TOGETHER_S:.0f} ms")
    other = _lens(ctx, stream, own)
    to_depth, to_picture = (falling.of_reference(stream, topic) for topic in (topics.depth, topics.image))
    if own != topics.lens and to_depth is not None and to_picture is not None and isinstance(other, Camera):
        motion, size = to_picture @ transforms.invert(to_depth), (lens.width, lens.height)
        return {n: registered(each, other.matrix(), motion, lens.project, size) for n, each in found.items()}
    _check_registered(ctx, other, topics, lens)
    return found


def _check_registered(ctx: Context, other: Camera | Lens, topics: CameraTopics, lens: Camera | Lens) -> None:
    """Raise for depth whose camera differs from that of the pictures."""
    same = (other.width, other.height) == (lens.width, lens.height)
    if not same or max(abs(other.fx / lens.fx - 1), abs(other.fy / lens.fy - 1)) > SAME:
        ctx.fail(
            f"the depth on `{topics.depth}` is not registered to the pictures",
            pictures=f"{lens.width} x {lens.height} px, fx {lens.fx:.1f} px",
            depth=f"{other.width} x {other.height} px, fx {other.fx:.1f} px",
            hint="record `aligned_depth_to_color` (`align_depth.enable:=true`), or leave option `depth` out",
        )


def _chosen(rows: object, stamps: np.ndarray, reach_s: float) -> dict[int, np.ndarray]:
    """The image nearest to each of the times, by number; images are read one by one."""
    found: dict[int, tuple[float, np.ndarray]] = {}
    for stamp, image in rows:  # type: ignore[attr-defined]
        number = int(np.abs(stamps - stamp).argmin())
        apart = abs(float(stamps[number]) - stamp)
        if apart <= reach_s and (number not in found or apart < found[number][0]):
            found[number] = (apart, image)
    return {number: image for number, (_, image) in found.items()}


def _check_size(ctx: Context, shape: tuple[int, ...], camera: Camera, topic: str, lens: str) -> None:
    if shape != (camera.height, camera.width):
        ctx.fail(
            f"the images on `{topic}` have another size than the intrinsics on `{lens}`",
            images=f"{shape[1]} x {shape[0]} px",
            intrinsics=f"{camera.width} x {camera.height} px",
            hint="choose the topic of their own intrinsics by `camera_info`; depth must be registered to the pictures",
        )
