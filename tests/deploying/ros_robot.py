"""A robot as a node of ROS 2, run by `.venv/readers/ros`: `ros_robot.py DOMAIN SECONDS OUT.json NAME=POSITION ...`.

It publishes joint states at 100 Hz and pictures at 15 Hz, moves at once to what it is commanded, and writes what it
received.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def main(domain: int, seconds: float, out: str, *placed: str) -> None:
    rclpy.init(domain_id=domain)
    node = rclpy.create_node("robot")
    joints = {name: float(place) for name, place in (each.split("=") for each in placed)}
    got: dict[str, Any] = {"trajectories": [], "numbers": [], "status": [], "late": 0}

    def moved(message: JointTrajectory) -> None:
        point = message.points[-1]
        got["trajectories"].append([list(message.joint_names), list(point.positions), point.time_from_start.nanosec])
        stamp, reach = message.header.stamp, point.time_from_start
        ends = (stamp.sec + reach.sec) * 10**9 + stamp.nanosec + reach.nanosec
        if stamp.sec and ends < node.get_clock().now().nanoseconds:
            return  # as the JointTrajectory controller of ros2_control does
        got["late"] += bool(got["status"]) and got["status"][-1].startswith("stopped")
        joints.update(zip(message.joint_names, point.positions, strict=True))

    node.create_subscription(JointTrajectory, "/joint_trajectory", moved, 10)
    node.create_subscription(Float64MultiArray, "/numbers", lambda each: got["numbers"].append(list(each.data)), 10)
    node.create_subscription(String, "/dxb/status", lambda each: got["status"].append(each.data), KEPT)
    states = node.create_publisher(JointState, "/joint_states", 10)
    pictures = node.create_publisher(CompressedImage, "/camera/image/compressed", qos_profile_sensor_data)

    def state() -> None:
        message = JointState(name=list(joints), position=list(joints.values()))
        message.header.stamp = node.get_clock().now().to_msg()
        states.publish(message)

    def picture() -> None:
        message = CompressedImage(format="jpeg", data=bytes(range(256)) * 160)
        message.header.stamp = node.get_clock().now().to_msg()
        pictures.publish(message)

    node.create_timer(0.01, state)
    node.create_timer(1 / 15, picture)
    print("ready", flush=True)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    with open(out, "w") as file:
        json.dump(got, file)


main(int(sys.argv[1]), float(sys.argv[2]), *sys.argv[3:])
