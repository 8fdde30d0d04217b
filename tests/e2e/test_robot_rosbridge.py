"""`dxb robot` and `dxb run` by rosbridge: a server that others wrote, before a robot that speaks DDS."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")

from dextera_build.deploying.dds import Dds
from tests.deploying import bridges
from tests.e2e.robots import DOMAIN, LINE, NAMES, SEEING, built, drove, ended, ran, started
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
            blind = space.dxb("robot", "doctor", "task/try", *NAMES, *by[:3], f"127.0.0.1:{bare}")
            assert (blind.code, "DXB-E447" in blind.err) == (4, True)
            drove(space, started(space, *SEEING), *by)

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
