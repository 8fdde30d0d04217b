"""Nodes of ROS 2 in the environment of `rclpy`, which `make readers` makes."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.readers import ENVIRONMENTS

SCRIPT = Path(__file__).with_name("ros_robot.py")


class Node:
    """A running node.

    Args:
        process: Its process.
        out: What it writes at its end.
    """

    def __init__(self, process: subprocess.Popen[str], out: Path) -> None:
        self._process, self._out = process, out

    def freeze(self, *, stop: bool) -> None:
        """Stop the process, or let it continue: for others it is a network that is cut."""
        self._process.send_signal(signal.SIGSTOP if stop else signal.SIGCONT)

    def ended(self) -> dict[str, Any]:
        """What it received, after its end."""
        _, err = self._process.communicate(timeout=60)
        assert self._process.returncode == 0, err[-3000:]
        assert "type hash" not in err, err[-3000:]
        found: dict[str, Any] = json.loads(self._out.read_text())
        return found


def python() -> str:
    """A Python with rclpy; the test is skipped without its environment."""
    home = ENVIRONMENTS / "ros"
    if not (home / ".installed").exists():
        pytest.skip("needs .venv/readers/ros; `make readers` makes it")
    return str(home / "bin" / "python")


@contextlib.contextmanager
def robot(domain: int, seconds: float, out: Path, joints: Mapping[str, float]) -> Iterator[Node]:
    """A robot by rclpy, without multicast; the test is skipped without its environment."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "ROS_", "CYCLONEDDS"))}
    kept["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    command = [python(), str(SCRIPT), str(domain), str(seconds), str(out)]
    command += [f"{name}={place}" for name, place in joints.items()]
    process = subprocess.Popen(command, env=kept, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n", process.communicate(timeout=10)[1]
        yield Node(process, out)
    finally:
        process.kill()
        process.wait(10)
