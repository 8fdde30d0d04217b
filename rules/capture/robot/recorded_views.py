"""capture.recorded_views: a calibration capture from a recording of a camera and a robot."""

from __future__ import annotations

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.rule import Context, rule

from . import recorded


class RecordedViewsOptions(recorded.RecordedOptions, recorded.TopicOptions):
    """Options of capture.recorded_views."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "mujoco", "numpy", "pillow", "scipy"))
def recorded_views(
    ctx: Context,
    stream: Stream,
    states: Stream | None = None,
    robot: RobotModel | None = None,
    *,
    options: RecordedViewsOptions,
) -> RobotViews:
    """Return one picture per rest of the robot, with joint positions interpolated to its stamp.

    `states` is the recording of the robot if it differs from that of the camera. The offset of their clocks is
    estimated from the times at which pictures change and joints move, and applied if it is certain. Joint states are
    put in the order of `robot` and refused if they are not consistent with it: missing names, positions beyond limits
    (degrees, millimetres, another order), or poses that rotate differently from its model.
    """
    found = recorded.views(ctx, stream, states or stream, robot, options, options)
    ctx.say(", ".join(found.facts()))
    return found
