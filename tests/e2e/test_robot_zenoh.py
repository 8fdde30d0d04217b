"""`dxb robot` and `dxb run` by Zenoh, in processes of their own."""

from __future__ import annotations

import pytest

from tests.e2e.robots import NAMES, SEEING, TARGETS, built, ended, ran, started
from tests.e2e.space import Space

pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra `zenoh`)")


@pytest.mark.slow
def test_a_policy_drives_a_robot_by_zenoh(space: Space) -> None:
    built(space)
    zenoh = ("--transport", "zenoh")
    nobody = space.dxb("run", "task/try", "--policy", "task/try:policy", *NAMES, *zenoh)
    assert nobody.code == 4
    assert "no Zenoh router answers at `tcp/127.0.0.1:7447`" in nobody.err
    robot = started(space, *SEEING, *zenoh)
    try:
        doctor = space.dxb("robot", "doctor", "task/try", "--json", *NAMES, *SEEING, *zenoh)
        assert (doctor.code, doctor.document["failed"]) == (0, 0), doctor.err
        code, told = ran(space, "whole.mcap", *SEEING, *zenoh)
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert 2 * told["steps"] == heard["commands"] == 40
    assert heard["joints"] == pytest.approx(TARGETS, abs=5e-3)
    assert heard["status"] == ["running", "stopped: not done within 4 s"]

    robot = started(space, "--fault", "cut@1", *zenoh)
    try:
        code, told = ran(space, "cut.mcap", *zenoh)
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (1, "the guard stopped the robot: no joint states arrived for more than 0.4 s")
    assert heard["commands_after_stop"] == 0
