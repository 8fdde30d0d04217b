"""capture.recorded_picture: one picture of a recording, with its depth and the direction of gravity."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeFloat

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.formats import mcap
from dextera_build.rule import Context, rule

from ..taken import DepthOptions
from . import frames, topics


class RecordedPictureOptions(DepthOptions):
    """Options of capture.recorded_picture."""

    image: str = ""
    """Topic of the pictures; empty: the only one."""
    depth: str = ""
    """Topic of depth that is registered to the pictures, or of a RealSense recording; empty: the only one, if any."""
    camera_info: str = ""
    """Topic of the intrinsics; empty: the one next to the pictures' topic."""
    at_s: NonNegativeFloat | None = None
    """Time after the first picture [s]; the nearest picture is taken. None: the middle one."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "numpy", "pillow"))
def recorded_picture(ctx: Context, stream: Stream, *, options: RecordedPictureOptions) -> Capture:
    """Return one picture of a recording as a capture, with depth and the direction in which things fall, if recorded.

    Gravity comes from `sensor_msgs/Imu` of a camera at rest. Its axes are those of the picture if both messages name
    the same frame; otherwise `/tf_static`, or the extrinsics of a RealSense recording, tell how the sensor is mounted.
    """
    depth = options.depth or topics.only_depth(ctx, stream)
    seen = topics.of_camera(ctx, stream, options.image, depth, options.camera_info)
    stamps = np.sort(mcap.stamps(stream, seen.image)[:, 0])
    since = stamps - stamps[0]
    wanted = since[-1] / 2 if options.at_s is None else options.at_s
    ctx.check(
        wanted <= since[-1],
        f"the pictures end {since[-1]:.1f} s after the first one",
        at_s=f"{wanted:g}",
        hint="lower `at_s`",
    )
    nearest = int(np.abs(since - wanted).argmin())
    (capture,) = frames.at(ctx, stream, seen, stamps[[nearest]], options, "picture").values()
    camera, gravity, measured = capture.photograph.camera, capture.photograph.gravity, capture.measured
    said = [f"{camera.width} x {camera.height} px at {since[nearest]:.2f} s of {since[-1]:.2f} s"]
    said.append("no depth" if measured is None else f"depth on {(measured.depth.depth > 0).mean():.0%} of them")
    if gravity is not None:
        said.append(f"the camera looks down by {np.degrees(np.arcsin(gravity[2])):.1f} deg")
    ctx.preview(capture.photograph.rgb.pixels, "photograph")
    ctx.say(", ".join(said))
    return capture
