"""capture.pair: two measured photographs as a video of two frames."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy", "pillow"))
def pair(ctx: Context, first: Capture, second: Capture, first_pose: Pose, second_pose: Pose) -> RgbdVideo:
    """Return a video of two frames, a second apart, for `align.track`.

    Args:
        ctx: Context.
        first: Photograph with depth.
        second: Photograph with depth of the same camera.
        first_pose: T_world_camera of the first [m].
        second_pose: T_world_camera of the second [m].
    """
    for name, capture in (("first", first), ("second", second)):
        ctx.check(
            capture.measured is not None,
            f"the {name} photograph has no depth",
            hint="take it with depth: objects are found again by their surfaces",
        )
    one, two = (each.photograph.camera for each in (first, second))
    ctx.check(
        one == two,
        "the two photographs have different intrinsics",
        first=one,
        second=two,
        hint="use the same camera and size, and one `capture.json`",
    )

    def frames() -> Iterator[RgbdFrame]:
        for stamp, (capture, pose) in enumerate(((first, first_pose), (second, second_pose))):
            assert capture.measured is not None
            rgb, depth = capture.photograph.rgb.pixels, capture.measured.depth.depth
            yield RgbdFrame(float(stamp), rgb, depth, pose.matrix)

    found = RgbdVideo.write(ctx.scratch / "pair.zip", one, frames())
    ctx.say(", ".join(found.facts()))
    return found
