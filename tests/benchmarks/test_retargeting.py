"""The program that measures retargeting beside dex-retargeting: its kinematics, its rows, and the peer itself."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.retarget.matching import matched
from tests.benchmarks.retargeting import __main__ as program
from tests.benchmarks.retargeting import urdf
from tests.robots.robot_recipes import built

PEER = Path(__file__).parents[2] / ".venv" / "dexret" / "bin" / "python"


@pytest.fixture(scope="module")
def leap(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("kuka_leap", tmp_path_factory.mktemp("robot"))


def cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip("|").split("|")]


@pytest.mark.medium
def test_the_urdf_of_the_peer_has_the_kinematics_of_the_robot(leap: RobotModel) -> None:
    own = matched(leap, "arm")
    wrist = np.eye(4)
    wrist[:3, 3] = [0.1, -0.2, 0.3]
    text = urdf.written(own.hand, {"wrist": wrist}, {f"tip_{place}": place for place in range(4)})
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    model = spec.compile()
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(4):
        posture = random.uniform(own.hand.lower, own.hand.upper)
        for name, position in zip(own.hand.joints, posture, strict=True):
            data.joint(name).qpos[0] = position
            assert model.joint(name).range == pytest.approx(
                [own.hand.lower[own.hand.joints.index(name)], own.hand.upper[own.hand.joints.index(name)]]
            )
        mujoco.mj_kinematics(model, data)
        found = np.array([data.body(f"tip_{place}").xpos for place in range(4)])
        assert found == pytest.approx(own.hand.at(posture).tips, abs=1e-6)
        assert data.body("wrist").xpos == pytest.approx(wrist[:3, 3])


@pytest.mark.slow
def test_a_row_has_a_cell_for_every_measurement(leap: RobotModel) -> None:
    rows = [cells(row) for row in program.rows(leap, "arm", 20.0, None)]
    heads = cells(program.HEAD.splitlines()[0])
    assert [row[0] for row in rows] == ["dxb", "dxb, no filter"]
    assert all(len(row) == len(heads) for row in rows)
    for row in rows:
        assert 0 < float(row[1]) < 15
        assert float(row[3].split(",")[0]) < 5, "gap of a pinch [mm]"
        assert row[5] == "0 %"
    assert float(rows[0][6]) < float(rows[1][6]), "jerk"


@pytest.mark.slow
@pytest.mark.skipif(not PEER.exists(), reason="needs `make .venv/dexret/.installed`")
def test_dxb_is_not_worse_than_the_peer_in_any_column(leap: RobotModel, capsys: pytest.CaptureFixture[str]) -> None:
    """Time, which depends on what else the machine does, stands in the table alone."""
    made = {row[0]: row for row in (cells(row) for row in program.rows(leap, "arm", 72.0, PEER))}
    with capsys.disabled():
        print("\n".join(["", program.HEAD, *(f"| {' | '.join(row)} |" for row in made.values())]))
    ours = made["dxb"]
    peers = {name: row for name, row in made.items() if name.startswith("dex-retargeting") and "no filter" not in name}
    assert len(peers) == 4
    for name, row in peers.items():
        for column in (1, 2, 3, 6, 7):
            mine, theirs = (float(each[column].split(",")[0]) for each in (ours, row))
            assert mine <= theirs + 0.05, (name, program.HEAD.split("|")[column + 1], mine, theirs)
