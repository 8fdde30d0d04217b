"""The program that measures stepping beside MuJoCo, on a small task whose physics is so cheap that all else shows.

`python -m tests.benchmarks.stepping cache/out/task/lift_blue_mug/task/task.bundle` measures built ones.
"""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from tests import task_bundles
from tests.benchmarks.stepping import __main__ as program
from tests.benchmarks.stepping import ours, peers

pytestmark = pytest.mark.slow


def test_a_row_has_a_cell_for_every_measurement(capsys: pytest.CaptureFixture[str]) -> None:
    with capsys.disabled():
        row = program.row("small", task_bundles.lift(), 20)
        print(f"\n{row}")
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:2] == ["`small`", "18, 25 x 2 ms"]
    verdict, reward = (float(cell.rstrip(" %")) for cell in cells[2:4])
    assert 30 < reward < verdict < 100
    assert float(cells[5]) > 20, "times real time"
    middle, late = (float(cell) for cell in cells[6].split(","))
    assert middle <= late
    assert middle < 5
    assert 0.5 < float(cells[7]) < 2


def test_a_ratio_is_that_of_the_work() -> None:
    work = np.random.default_rng(0).random((120, 120))
    once, twice = (lambda: work @ work @ work), (lambda: [work @ work @ work for _ in range(2)])
    assert 1.5 < ours.paired(twice, once, 200) < 2.5


def test_a_peer_that_is_not_there_is_told_in_its_row() -> None:
    absent = dict.fromkeys(["robosuite", "gymnasium_robotics", "dm_control"])
    code = f"import runpy, sys; sys.modules.update({absent}); sys.argv[1:] = ['1']"
    code += f"; runpy.run_path({peers.__file__!r}, run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["package"] for row in found] == list(absent)
    assert all("does not run" in program.peer_row(row) for row in found)


def test_a_peer_that_runs_has_its_share() -> None:
    found = {
        "package": "robosuite",
        "version": "1.0",
        "mujoco": "3.3",
        "name": "Lift",
        "substeps": 25,
        "timestep": 0.002,
    }
    row = program.peer_row(found | {"nv": 15, "share": 0.145})
    assert row == "| robosuite 1.0, Lift, MuJoCo 3.3 | 15, 25 x 2 ms | 14 % |"
