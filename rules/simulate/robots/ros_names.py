"""simulate.ros_names: names of a robot in ROS 2."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule


class ControllerOptions(Options):
    """A controller that takes targets of joints."""

    topic: str
    """Topic of its commands: `/arm_controller/joint_trajectory`."""
    kind: Literal["trajectory", "forward"] = "trajectory"
    """Its messages: `trajectory`: JointTrajectory; `forward`: Float64MultiArray of a `forward_command_controller`."""
    joints: tuple[str, ...] = ()
    """Its joints as the robot model names them, in its order; empty: all of the robot."""


class RosNamesOptions(Options):
    """Options of simulate.ros_names; an empty topic is the one of the declared term."""

    joint_states: str | tuple[str, ...] = ""
    """Topic of JointState, or topics, if several drivers publish those of their own joints."""
    joints: dict[str, str] = Field(default_factory=dict)
    """Joint of the robot model -> its name in messages, if it has another one there."""
    flipped: tuple[str, ...] = ()
    """Joints of the robot model whose positions have the other sign in messages."""
    controllers: tuple[ControllerOptions, ...] = ()
    """What takes commands; empty: one JointTrajectory controller of all joints, on `/joint_trajectory`."""
    pictures: dict[str, str] = Field(default_factory=dict)
    """Camera -> topic of CompressedImage."""
    depths: dict[str, str] = Field(default_factory=dict)
    """Camera -> topic of Image with its depth, registered to the pictures."""
    objects: str = ""
    """Topic of TFMessage on which a tracker publishes poses of objects."""
    displacement: str = ""
    """Topic of JointState with the positions of the objects' joints."""
    base: str = "base"
    """Frame of the robot's base in transforms."""


@rule(version=1)
def ros_names(ctx: Context, robot: RobotModel, *, options: RosNamesOptions) -> RosNames:
    """Return the names of the robot's topics, joints, frames and controllers in ROS 2, for `dxb run`."""
    every = [joint.name for joint in robot.joints]
    given = [joint for each in options.controllers for joint in each.joints or every]
    unknown = sorted({*options.joints, *options.flipped, *given} - {*every})
    ctx.check(not unknown, f"{listing(unknown)} are no joints of this robot", joints=listing(every, most=40))
    without = [joint for joint in every if joint not in given] if options.controllers else []
    ctx.check(not without, f"{listing(without)} belong to no controller", controllers=len(options.controllers))
    twice = sorted({joint for joint in given if given.count(joint) > 1})
    ctx.check(not twice, f"{listing(twice)} belong to several controllers")
    ctx.say(f"{len(options.controllers) or 1} controllers of {len(every)} joints, {len(options.joints)} renamed")
    fields = dict(options)
    return RosNames(**fields | {"controllers": tuple(Controller(**dict(each)) for each in options.controllers)})
