"""capture.recorded_cameras: calibration captures of several cameras from one recording."""

from __future__ import annotations

from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.rule import Context, rule

from . import recorded


class RecordedCamerasOptions(recorded.RecordedOptions):
    """Options of capture.recorded_cameras."""

    cameras: dict[str, recorded.TopicOptions] = Field(default_factory=dict)
    """Name of a camera -> its topics."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "mujoco", "numpy", "pillow", "scipy"))
def recorded_cameras(
    ctx: Context,
    stream: Stream,
    states: Stream | None = None,
    robot: RobotModel | None = None,
    *,
    options: RecordedCamerasOptions,
) -> Collection[RobotViews]:
    """Return for each camera the result of `capture.recorded_views`."""
    if not options.cameras:
        ctx.fail("no camera is named", hint="`cameras: {front: {image: /front/image_raw}, ...}`")
    found = {
        name: recorded.views(ctx, stream, states or stream, robot, where, options, name)
        for name, where in options.cameras.items()
    }
    ctx.say(", ".join(f"{name}: {len(each.captures)} pictures" for name, each in found.items()))
    return Collection[RobotViews](items=found)
