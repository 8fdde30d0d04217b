"""Topics of a robot: names, types and qualities of service, from the declared terms and the names of the robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.deploying.transport import SENSOR, Quality, Topic
from dextera_build.errors import RuleError, listing
from dextera_build.policy import robot_run
from dextera_build.policy.declared import BY_NAME

STATUS = Topic(robot_run.STATUS, "std_msgs/String", Quality(keeps=True, depth=1))
"""What a run does, and why it ended."""
SIMULATED = Topic("/dxb/simulated", "std_msgs/String", Quality(keeps=True, depth=1))
"""The world behind a robot that is simulated; real robots do not publish it."""
COMMAND_KINDS = {"trajectory": "trajectory_msgs/JointTrajectory", "forward": "std_msgs/Float64MultiArray"}
"""Kind of a controller -> type of its commands."""


@dataclass(frozen=True)
class Commanded:
    """A controller of a robot."""

    topic: Topic
    """Topic of its commands."""
    joints: tuple[str, ...]
    """Its joints as the robot model names them."""


@dataclass(frozen=True)
class Topics:
    """All topics of a robot, with the qualities that dxb requests or offers."""

    names: RosNames
    """Names of joints and frames in messages."""
    joints: Topic
    """Positions of the robot's joints."""
    more_joints: tuple[Topic, ...]
    """Further topics with them, of other drivers."""
    objects: Topic
    """Poses of objects from a tracker."""
    displacement: Topic
    """Positions of the objects' joints."""
    pictures: dict[str, Topic]
    """Camera -> its compressed pictures."""
    depths: dict[str, Topic]
    """Camera -> its depth, registered to the pictures."""
    controllers: tuple[Commanded, ...]
    """What takes commands; every joint belongs to one of them."""

    @property
    def states(self) -> tuple[Topic, ...]:
        """All topics with positions of the robot's joints."""
        return (self.joints, *self.more_joints)

    def measured(self) -> tuple[Topic, ...]:
        """Topics that dxb reads."""
        return (*self.states, self.objects, self.displacement, *self.pictures.values(), *self.depths.values())


def of_robot(robot: RobotModel, names: RosNames, cameras: Iterable[str] = ()) -> Topics:
    """The topics of a robot.

    Args:
        robot: The embodiment.
        names: Its names in ROS 2.
        cameras: Cameras that are read.

    Raises:
        RuleError: A name is no joint of the robot, or is that of several, or a joint has no controller, or several.
    """
    every = tuple(joint.name for joint in robot.joints)
    given = names.controllers or (Controller(topic=BY_NAME["action"].topic),)
    controllers = tuple(Commanded(Topic(each.topic, COMMAND_KINDS[each.kind]), each.joints or every) for each in given)
    _check(every, names, [joint for each in controllers for joint in each.joints])
    given_states = names.joint_states
    states = (given_states,) if isinstance(given_states, str) else given_states or ("",)
    return Topics(
        names=names,
        joints=_read("joints", states[0]),
        more_joints=tuple(_read("joints", each) for each in states[1:]),
        objects=_read("objects", names.objects),
        displacement=_read("displacement", names.displacement),
        pictures={camera: _read("rgb", names.pictures.get(camera, ""), camera) for camera in cameras},
        depths={camera: _read("depth", names.depths.get(camera, ""), camera) for camera in cameras},
        controllers=controllers,
    )


def offered(topic: Topic) -> Topic:
    """A topic as robots and trackers offer it: joint states and transforms are reliable."""
    return Topic(topic.name, topic.kind, Quality())


def beside(picture: str) -> str:
    """Topic of the `sensor_msgs/CameraInfo` of a camera's pictures, by the convention of image_transport."""
    return f"{picture.removesuffix('/compressed').rpartition('/')[0]}/camera_info"


def _read(term: str, name: str, camera: str = "") -> Topic:
    declared = BY_NAME[term]
    return Topic(name or declared.topic.format(camera), declared.message, SENSOR)


def _check(every: tuple[str, ...], names: RosNames, commanded: list[str]) -> None:
    """Raise unless every joint is named and commanded once."""
    unknown = sorted({*names.joints, *names.flipped, *commanded} - {*every})
    twice = sorted({joint for joint in commanded if commanded.count(joint) > 1})
    without = [joint for joint in every if joint not in commanded]
    named = [names.joints.get(joint, joint) for joint in every]
    alike = sorted({name for name in named if named.count(name) > 1})
    for wrong, what in (
        (unknown, "are no joints of this robot"),
        (twice, "belong to several controllers"),
        (without, "belong to no controller"),
        (alike, "are the names of several joints"),
    ):
        if wrong:
            raise RuleError(
                f"the names of ROS 2 do not fit the robot: {listing(wrong)} {what}",
                code="DXB-B550",
                facts={"joints": listing(every, most=40)},
                hint="correct the node of `simulate.ros_names` of the robot's recipe",
            )
