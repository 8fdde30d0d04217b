"""Names of a robot in ROS 2: its topics, joints and controllers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.base import Artifact, Value


class Controller(Value):
    """A controller of a robot that takes targets of joints."""

    topic: str
    """Topic of its commands: `/arm_controller/joint_trajectory`."""
    kind: Literal["trajectory", "forward"] = "trajectory"
    """`trajectory` takes `trajectory_msgs/JointTrajectory` with one point, to be reached within a control period;
    `forward` takes `std_msgs/Float64MultiArray`, as `forward_command_controller` of ros2_control."""
    joints: tuple[str, ...] = ()
    """Its joints as the robot model names them, in its order; empty: all of the robot."""


class RosNames(Artifact):
    """Names that a robot uses in ROS 2; an empty name stands for the one of the declared term."""

    joint_states: str | tuple[str, ...] = ""
    """Topic of `sensor_msgs/JointState`, or topics, if several drivers publish those of their own joints."""
    joints: dict[str, str] = Field(default_factory=dict)
    """Joint of the robot model -> its name in messages, if it has another one there."""
    flipped: tuple[str, ...] = ()
    """Joints of the robot model whose positions have the other sign in messages."""
    controllers: tuple[Controller, ...] = ()
    """What takes commands; none: one of all joints, on the topic of term `action`."""
    pictures: dict[str, str] = Field(default_factory=dict)
    """Camera -> topic of `sensor_msgs/CompressedImage`."""
    depths: dict[str, str] = Field(default_factory=dict)
    """Camera -> topic of `sensor_msgs/Image` with its depth, registered to the pictures."""
    objects: str = ""
    """Topic of `tf2_msgs/TFMessage` on which a tracker publishes poses of objects."""
    displacement: str = ""
    """Topic of `sensor_msgs/JointState` with the positions of the objects' joints."""
    base: str = "base"
    """Frame of the robot's base in transforms."""
