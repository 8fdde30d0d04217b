"""`dxb robot` and `dxb run` by Zenoh, in processes of their own."""

from __future__ import annotations

import pytest

from tests.e2e.robots import NAMES, SEEING, built, drove, ended, ran, started
from tests.e2e.space import Space

pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra `zenoh`)")


@pytest.mark.slow
def test_a_policy_drives_a_robot_by_zenoh(space: Space) -> None:
    built(space)
    zenoh = ("--transport", "zenoh")
    nobody = space.dxb("run", "task/try", "--policy", "task/try:policy", *NAMES, *zenoh)
    assert nobody.code == 4
    assert "no Zenoh router answers at `tcp/127.0.0.1:7447`" in nobody.err
    drove(space, started(space, *SEEING, *zenoh), *zenoh)

    robot = started(space, "--fault", "cut@1", *zenoh)
    try:
        code, told = ran(space, "cut.mcap", *zenoh)
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (1, "the guard stopped the robot: no joint states arrived for more than 0.4 s")
    assert heard["commands_after_stop"] == 0
