"""A robot's node by ROBOTIS' zenoh-ros2-sdk, run in its own environment: `zenoh_node.py PORT DOMAIN SECONDS`.

It publishes joint states, reads numbers and a text that was published before it came, and prints as JSON what it got.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, utils
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession

TYPES = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
    "std_msgs/msg/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    "std_msgs/msg/String": "string data\n",
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
}


def main() -> None:
    """Publish at 50 Hz until the end."""
    port, domain, seconds = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    session = ZenohSession.get_instance("127.0.0.1", port)
    for kind, text in TYPES.items():
        session.register_message_type(text, kind)
    kinds = session.store.types
    got: dict[str, list[object]] = {"numbers": [], "kept": []}

    def settings(kind: str) -> dict[str, object]:
        others = {name: text for name, text in TYPES.items() if name != kind}
        return {
            "msg_type": kind,
            "msg_definition": TYPES[kind],
            "domain_id": domain,
            "router_port": port,
            "type_hash": utils.get_type_hash(kind, TYPES[kind], others),
        }

    states = ROS2Publisher("/joint_states", **settings("sensor_msgs/msg/JointState"))
    numbers = ROS2Subscriber(
        "/numbers", callback=lambda m: got["numbers"].append(list(m.data)), **settings("std_msgs/msg/Float64MultiArray")
    )
    kept = ROS2Subscriber(
        "/kept",
        callback=lambda m: got["kept"].append(m.data),
        qos=QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1),
        **settings("std_msgs/msg/String"),
    )
    print("ready", flush=True)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        now = time.time_ns()
        stamp = kinds["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
        empty = np.zeros(0)
        states.publish(header=header, name=["a", "b"], position=np.array([0.5, -1.0]), velocity=empty, effort=empty)
        time.sleep(0.02)
    print(json.dumps(got | {"hashes": [each.type_hash for each in (states, numbers, kept)]}), flush=True)
    # Threads of its session would keep the process alive.
    for each in (states, numbers, kept, session):
        each.close()


if __name__ == "__main__":
    main()
