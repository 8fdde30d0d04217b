"""`dxb robot` and `dxb run` by rosbridge: a server that others wrote, before a robot that speaks DDS."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")

from dextera_build.deploying.dds import Dds
from tests.deploying import bridges
from tests.e2e.robots import DOMAIN, LINE, NAMES, SEEING, TARGETS, built, ended, ran, started
from tests.e2e.space import Space


@pytest.mark.slow
def test_a_policy_drives_a_robot_by_rosbridge(space: Space, tmp_path: Path) -> None:
    (tmp_path / "bridge").mkdir()
    with bridges.server(int(DOMAIN), tmp_path / "bridge") as bare:
        built(space)
        # The node's installation has no tf2_msgs, so that the policy goes without poses of objects.
        space.write("rules/learn/line/line.py", LINE.replace(', contract.channel(here, "objects")', ",").lstrip())
        assert space.build("task/try").code == 0
        graph = Dds(domain=int(DOMAIN))
        with bridges.with_rosapi(bare, graph) as port:
            by = ("--transport", "rosbridge", "--robot", f"127.0.0.1:{port}")
            refused = space.dxb("robot", "simulate", "task/try", *NAMES, "--transport", "rosbridge")
            assert (refused.code, "DXB-U352" in refused.err) == (2, True)
            nobody = space.dxb("run", "task/try", "--policy", "task/try:policy", *NAMES, *by)
            assert nobody.code == 4
            assert "/joint_states is published: nobody publishes it" in nobody.err
            robot = started(space, *SEEING)
            try:
                blind = space.dxb("robot", "doctor", "task/try", *NAMES, *by[:3], f"127.0.0.1:{bare}")
                assert (blind.code, "DXB-E447" in blind.err) == (4, True)
                doctor = space.dxb("robot", "doctor", "task/try", "--json", *NAMES, *SEEING, *by)
                assert (doctor.code, doctor.document["failed"]) == (0, 0), doctor.err
                code, told = ran(space, "whole.mcap", *SEEING, *by)
            finally:
                heard = ended(robot)
            assert (code, told["reason"]) == (0, "not done within 4 s")
            assert 2 * told["steps"] == heard["commands"] == 40
            assert heard["joints"] == pytest.approx(TARGETS, abs=5e-3)
            assert heard["status"] == ["running", "stopped: not done within 4 s"]

            robot = started(space, "--fault", "joint_states_stop@1")
            try:
                code, told = ran(space, "cut.mcap", *by)
            finally:
                heard = ended(robot)
        graph.close()
    silent = "the guard stopped the robot: no joint states arrived for more than 0.4 s"
    assert (code, told["reason"]) == (1, silent)
    assert heard["commands"] == 2 * told["steps"] < 40
    assert heard["commands_after_stop"] == 0
