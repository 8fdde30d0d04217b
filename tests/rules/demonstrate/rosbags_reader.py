"""Reads a recording with rosbags, which knows ROS 2's messages by itself: `rosbags_reader.py FILE OUT.json`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

STANDARD = get_typestore(Stores.ROS2_HUMBLE)
VALUES = {
    "/joint_states": lambda message: message.position.tolist(),
    "/joint_trajectory": lambda message: message.points[0].positions.tolist(),
    "/wrench/tip_right": lambda message: [getattr(message.wrench.force, axis) for axis in "xyz"],
    "/tf": lambda message: [getattr(message.transforms[0].transform.rotation, part) for part in "xyzw"],
}


def main(file: str, out: str) -> None:
    """Decode every message, by the file's own schemas and by the standard ones, and write some values."""
    found: dict[str, Any] = {topic: [] for topic in VALUES}
    with AnyReader([Path(file)], default_typestore=STANDARD) as reader:
        for connection, _, data in reader.messages():
            own = reader.deserialize(data, connection.msgtype)
            standard = STANDARD.deserialize_cdr(data, connection.msgtype)
            if connection.topic in VALUES:
                value = VALUES[connection.topic](own)
                assert value == VALUES[connection.topic](standard)
                found[connection.topic].append(value)
        qualities = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
    found["qos"] = {topic: profiles[0].durability.name for topic, profiles in qualities.items() if profiles}
    Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
