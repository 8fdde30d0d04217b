"""Measurements and commands of a robot as messages: joints by name and sign, poses by frame, pictures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from dextera_build.deploying.plans import Command
from dextera_build.deploying.topics import COMMAND_KINDS, Commanded, Topics
from dextera_build.errors import listing
from dextera_build.formats.ros import hashes, messages
from dextera_build.formats.ros.reading import SECOND


class UnusableError(ValueError):
    """A message that holds no measurement; the text says why."""


def unpacked(kind: str, message: bytes) -> Any:
    """The fields of a message.

    Raises:
        UnusableError: It is damaged.
    """
    try:
        return hashes.read(kind, message)
    except ValueError as error:
        raise UnusableError(str(error)) from None


def stamp_of(header: Any) -> int:
    """The stamp of a message [ns]."""
    return int(header.stamp.sec * SECOND + header.stamp.nanosec)


class Joints:
    """Positions of named joints from joint states, and back.

    Args:
        joints: Joints of the model, in order.
        topics: Topics with the names in messages.
    """

    def __init__(self, joints: Sequence[str], topics: Topics) -> None:
        names = topics.names
        self._joints = tuple(joints)
        self._named = tuple(names.joints.get(joint, joint) for joint in joints)
        self._sign = np.array([-1.0 if joint in names.flipped else 1.0 for joint in joints])

    @property
    def names(self) -> tuple[str, ...]:
        """The joints as messages name them (A)."""
        return self._named

    def found(self, state: Any) -> dict[str, float]:
        """Joint, as messages name it -> its position [rad or m], of those in an unpacked joint state.

        Raises:
            UnusableError: A position is not a finite number.
        """
        given = dict(zip(state.name, state.position, strict=False))
        places = {name: float(given[name]) for name in self._named if name in given}
        bad = [name for name, place in places.items() if not np.isfinite(place)]
        if bad:
            raise UnusableError(f"the position of {listing(bad)} is not a finite number")
        signs = dict(zip(self._named, self._sign, strict=True))
        return {name: place * float(signs[name]) for name, place in places.items()}

    def positions(self, state: Any) -> np.ndarray:
        """Positions (A,) [rad or m] in an unpacked joint state.

        Raises:
            UnusableError: A joint is missing, or its position is not a finite number.
        """
        found = self.found(state)
        missing = [name for name in self._named if name not in found]
        if missing:
            raise UnusableError(f"it lacks {listing(missing)}; it has {listing(state.name, most=40) or 'no joint'}")
        return np.array([found[name] for name in self._named], np.float64)

    def state(self, stamp: int, positions: np.ndarray) -> bytes:
        """A joint state of positions (A,) [rad or m]."""
        return messages.joint_state(stamp, self._named, positions * self._sign)

    def command(self, stamp: int, controller: Commanded, targets: np.ndarray, reach: int) -> bytes:
        """The command of one controller, from targets (A,) of all joints, to be reached after `reach` ns."""
        rows = [self._joints.index(joint) for joint in controller.joints]
        names, values = [self._named[row] for row in rows], (targets * self._sign)[rows]
        if controller.topic.kind == COMMAND_KINDS["forward"]:
            return messages.numbers(names, values)
        return messages.joint_trajectory(stamp, names, values, reach)

    def commanded(self, controller: Commanded, message: bytes) -> Command:
        """The command of a controller, for the joints of the model.

        Raises:
            UnusableError: The message is damaged, or its controller refuses it.
        """
        read = unpacked(controller.topic.kind, message)
        named = {self._named[self._joints.index(joint)]: joint for joint in controller.joints}
        if controller.topic.kind == COMMAND_KINDS["forward"]:
            names, places, reach, stamp = list(named), [read.data], [0.0], 0
        else:
            names, places, stamp = read.joint_names, [point.positions for point in read.points], stamp_of(read.header)
            reach = [float(each.time_from_start.sec + each.time_from_start.nanosec / SECOND) for each in read.points]
        if places and sorted(names) != sorted(named):
            raise UnusableError(f"its joints are {listing(names)}, those of the controller {listing(named)}")
        for each in places:
            if len(each) != len(named):
                raise UnusableError(
                    f"its number of targets is {len(each)}, that of the controller's joints {len(named)}"
                )
        if not np.isfinite(np.array(places)).all() or (np.diff(reach) <= 0).any():
            raise UnusableError("its targets are not finite, or its times do not increase")
        signs = dict(zip(self._joints, self._sign, strict=True))
        rows = [dict(zip(names, each, strict=True)) for each in places]
        targets = tuple(tuple(float(row[name] * signs[joint]) for name, joint in named.items()) for row in rows)
        return Command(tuple(named.values()), stamp, tuple(reach), targets)


def poses(stamp: int, base: str, placed: Mapping[str, np.ndarray]) -> bytes:
    """Transforms of poses (7,) of objects in the frame `base`: position [m], quaternion w x y z."""
    return messages.transforms(stamp, [(base, name, pose) for name, pose in placed.items()])


def placed(message: Any, base: str, names: Collection[str]) -> dict[str, tuple[int, np.ndarray]]:
    """Stamp [ns] and pose (7,) with w >= 0 of each of `names` from frame `base` in an unpacked `TFMessage`.

    Raises:
        UnusableError: A pose is not finite, or its rotation is none.
    """
    found = {}
    for each in message.transforms:
        child = each.child_frame_id.lstrip("/")
        if each.header.frame_id.lstrip("/") != base or child not in names:
            continue
        at, turn = each.transform.translation, each.transform.rotation
        pose = np.array([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z])
        length = float(np.linalg.norm(pose[3:]))
        if not np.isfinite(pose).all() or abs(length - 1.0) > 1e-3:
            raise UnusableError(f"the pose of `{each.child_frame_id}` is not finite, or its rotation is none")
        pose[3:] *= (1.0 if pose[3] >= 0 else -1.0) / length
        found[child] = stamp_of(each.header), pose
    return found
