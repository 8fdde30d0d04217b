"""capture.rgbd: read an RGB-D video from a folder or a recording."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import listing
from dextera_build.formats import mcap
from dextera_build.rule import Context, Options, rule

from .facts import INTRINSICS
from .motion import stated

NAME = "views.json"


class RgbdOptions(Options):
    """Options of capture.rgbd."""

    colour_topic: str = "/camera/color/image_raw"
    """Topic of a recording with `sensor_msgs/Image` or `CompressedImage` of colour."""
    depth_topic: str = "/camera/aligned_depth_to_color/image_raw"
    """Topic of a recording with `sensor_msgs/Image` of depth, registered to the colour."""
    info_topic: str = "/camera/color/camera_info"
    """Topic of a recording with the `sensor_msgs/CameraInfo` of the colour."""
    apart_s: PositiveFloat = 0.02
    """Largest time difference between the colour and the depth picture of a frame [s]."""
    rate_hz: PositiveFloat = 30.0
    """Frame rate of a folder whose views have a `frame` and no `stamp` [Hz]."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "numpy", "pillow"))
def rgbd(ctx: Context, source: Folder | Stream, *, options: RgbdOptions | None = None) -> RgbdVideo:
    """Return the frames of a folder with `views.json`, or of three topics of a recording; depth is image-plane z [m].

    `views.json` holds width, height, fx, fy, cx, cy [px], `depth_scale_m` and `views`, each with the paths `rgb` and
    `depth`, a `stamp` [s] or a `frame` number, and optionally `T_world_camera` (OpenCV axes).
    """
    options = options or RgbdOptions()
    path = ctx.scratch / "rgbd.zip"
    if isinstance(source, Stream):
        camera = _pinhole(ctx, source, options.info_topic)
        found = RgbdVideo.write(path, camera, _recorded(ctx, source, options))
    else:
        found = _of_folder(ctx, source, options)
    ctx.check(
        _measured(found) > 0.05,
        "less than a twentieth of the first depth picture was measured",
        hint="check that the depth stream was running",
    )
    ctx.say(", ".join(found.facts()))
    return found


def _of_folder(ctx: Context, folder: Folder, options: RgbdOptions) -> RgbdVideo:
    if NAME not in folder.files:
        ctx.fail(
            f"`{NAME}` is missing",
            here=listing(folder.files),
            hint="write camera and views as described in docs/tracking.md",
        )
    try:
        said = json.loads(folder.files[NAME])
        camera = Camera(**{name: said[name] for name in INTRINSICS})
        views, scale = list(said["views"]), float(said["depth_scale_m"])
        rows = [_row(view, options) for view in views]
    except (ValueError, KeyError, TypeError) as error:
        ctx.fail(
            f"`{NAME}` cannot be read", why=f"{type(error).__name__}: {error}", hint="compare it with docs/tracking.md"
        )
    known = {pose is not None for *_, pose in rows}
    ctx.check(
        len(known) == 1, "some views have `T_world_camera`, and others have not", hint="state it for all, or for none"
    )
    missing = [path for _, *paths, _ in rows for path in paths if path not in folder.files]
    ctx.check(not missing, f"the picture `{missing[0] if missing else ''}` is missing", here=listing(folder.files))
    packed = (
        (stamp, ".png" if rgb.endswith(".png") else ".jpg", folder.files[rgb], folder.files[depth], pose)
        for stamp, rgb, depth, pose in sorted(rows, key=lambda row: row[0])
    )
    return RgbdVideo.pack(ctx.scratch / "rgbd.zip", camera, packed, depth_scale_m=scale)


def _row(view: Mapping[str, Any], options: RgbdOptions) -> tuple[float, str, str, np.ndarray | None]:
    """Time, both paths, and T_world_camera of a view."""
    stamp = float(view["stamp"]) if "stamp" in view else float(view["frame"]) / options.rate_hz
    pose = stated(view["T_world_camera"]) if "T_world_camera" in view else None
    return stamp, str(view["rgb"]), str(view["depth"]), pose


def _pinhole(ctx: Context, source: Stream, topic: str) -> Camera:
    lens = mcap.lens(source, topic)
    if not isinstance(lens, Camera):
        ctx.fail(
            f"the camera of `{topic}` has distortion, {type(lens).__name__}",
            hint="record the rectified topics, `image_rect_color` and the depth registered to them",
        )
    return lens


def _recorded(ctx: Context, source: Stream, options: RgbdOptions) -> Iterator[RgbdFrame]:
    """Each depth picture with the colour picture nearest in time; those without a partner are left out."""
    colours = mcap.pictures(source, options.colour_topic)
    before, after = None, next(colours, None)
    left_out = count = 0
    last = -np.inf
    for stamp, depth in mcap.depths(source, options.depth_topic):
        while after is not None and after[0] < stamp:
            before, after = after, next(colours, None)
        nearest = min((each for each in (before, after) if each is not None), key=lambda each: abs(each[0] - stamp))
        if abs(nearest[0] - stamp) > options.apart_s or stamp <= last:
            left_out += 1
            continue
        last, count = stamp, count + 1
        yield RgbdFrame(stamp, nearest[1], depth)
    if left_out:
        ctx.warn(f"{left_out} of {left_out + count} depth pictures have no colour picture within {options.apart_s:g} s")


def _measured(video: RgbdVideo) -> float:
    return float((next(video.frames([0])).depth > 0).mean())
