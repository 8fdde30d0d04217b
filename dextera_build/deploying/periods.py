"""What a recording says of each control period; `policy.robot_run` reads it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying.bag import BASE, Bag
from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import messages
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.observation import Measurement
from dextera_build.policy.robot_run import NEWEST, OBSERVED, topic


def observed(bag: Bag, time: int, bundle: TaskBundle, measured: Measurement, made: int) -> None:
    """Write what was measured, and where it places the links; an object without a pose is left out.

    Args:
        bag: The recording.
        time: When it was given to the policy [ns].
        bundle: The task.
        measured: What was measured.
        made: When its joint state was made, that of the time of a picture, by the clock here [ns].
    """
    joints = [joint.name for joint in bundle.robot.joints]
    bag.add(_topic(OBSERVED, "joints"), time, messages.joint_state(made, joints, measured.joints))
    rows = zip(bundle.objects, measured.objects, strict=True)
    edges = [(BASE, name, pose) for name, pose in rows if np.isfinite(pose).all()]
    inner = measured.displacement
    edges += bag.links(dict(zip((*joints, *bundle.displacement_names), (*measured.joints, *inner), strict=True)))
    bag.add(_topic(OBSERVED, "objects"), time, messages.transforms(time, edges))
    if len(inner) and np.isfinite(inner).all():
        message = messages.joint_state(time, bundle.displacement_names, inner)
        bag.add(_topic(OBSERVED, "displacement"), time, message)


def newest(bag: Bag, time: int, bundle: TaskBundle, made: int, places: np.ndarray) -> None:
    """Write the newest joint state (A,) [rad or m] at a time [ns], which was `made` at another, both by the clock here.

    A policy on pictures is given an older one, but the motion of the robot is in these.
    """
    joints = [joint.name for joint in bundle.robot.joints]
    bag.add(_topic(NEWEST, "joints"), time, messages.joint_state(made, joints, places))


def commanded(bag: Bag, time: int, bundle: TaskBundle, period: int, targets: Mapping[str, np.ndarray]) -> None:
    """Write joint targets.

    Args:
        bag: The recording.
        time: When they were sent [ns].
        bundle: The task.
        period: Duration of a control period [ns].
        targets: `REQUESTED` or `SENT` -> joint targets (A,) [rad or m].
    """
    joints = [joint.name for joint in bundle.robot.joints]
    bag.periods += 1
    for prefix, each in targets.items():
        bag.add(_topic(prefix, "action"), time, messages.joint_trajectory(time, joints, each, period))


def _topic(prefix: str, term: str) -> Topic:
    return Topic(topic(prefix, term), BY_NAME[term].message)
