"""The program that trains BC-RNN of dxb and of robomimic on the same data: what the peer sees, and its table."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.observation import Measurement, deployable
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import readers
from tests.benchmarks.policies import __main__ as program
from tests.benchmarks.policies import lerobot
from tests.benchmarks.policies.peer import Peer, by_feature

FEATURES = {"state": "observation.state", "object": "observation.environment_state", "goal": "observation.goal"}


@pytest.fixture(scope="module")
def task() -> tuple[TaskBundle, Episodes]:
    return program.chosen(None, 3)


def test_a_peer_sees_at_run_time_what_is_in_its_file(task: tuple[TaskBundle, Episodes], tmp_path: Path) -> None:
    bundle, episodes = task
    environment = Environment(bundle)
    file = program.exported(RuleRunner(tmp_path), bundle, episodes, tmp_path)
    with h5py.File(file) as opened:
        for number, (_, episode) in enumerate(episodes.in_order()):
            environment.begin(episode.start)
            observation = deployable(environment.measure(), environment.previous_action, environment.goal)
            seen = by_feature(of_bundle(bundle), observation)
            shown = {key: rows[0] for key, rows in opened[f"data/demo_{number}/obs"].items()}
            assert shown.keys() == FEATURES.keys()
            for key, row in shown.items():
                np.testing.assert_allclose(seen[FEATURES[key]], row, atol=1e-6)


@pytest.mark.slow
def test_robomimic_learns_from_the_file_and_answers_in_joint_targets(
    task: tuple[TaskBundle, Episodes], tmp_path: Path
) -> None:
    readers.run("robomimic", "-c", "")
    bundle, episodes = task
    file = program.exported(RuleRunner(tmp_path), bundle, episodes, tmp_path)
    setting = program.DEFAULTS | {"steps": 400, "hidden": 32, "file": str(file)}
    one = episodes.in_order()[0][1]
    with Peer("robomimic", setting, of_bundle(bundle), tmp_path) as peer:
        peer.reset()
        seen = [Measurement(*each) for each in zip(one.joints, one.objects, one.displacement, strict=True)]
        acted = np.array([peer.act(deployable(each, one.start.ctrl, one.goal)) for each in seen])
    missed = np.abs(acted - one.action).max(axis=1)
    assert np.median(missed) < 0.2 * np.ptp(one.action, axis=0).max()


@pytest.mark.slow
def test_the_table_has_a_row_for_each(task: tuple[TaskBundle, Episodes], tmp_path: Path) -> None:
    readers.run("robomimic", "-c", "")
    sizes = program.DEFAULTS | {"steps": 20, "hidden": 16, "least_std": 0.1}
    rows = program.compare(*task, sizes, 2, tmp_path)
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [each[0] for each in cells] == ["dxb `learn.bc_rnn`", "robomimic 0.3.0 BC-RNN-GMM"]
    assert all(float(each[2]) > 0 and "/2" in each[3] for each in cells)


@pytest.mark.slow
def test_lerobot_has_a_row_beside_each_of_dxb(
    task: tuple[TaskBundle, Episodes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    readers.installed(tmp_path, "lerobot", "lerobot-0.4")
    (tmp_path / "scratch").mkdir()
    monkeypatch.chdir(tmp_path)
    given = {"steps": 3, "batch": 8, "rate": 1e-3, "seed": 0}
    rows = lerobot.compare(*task, "act", given, 1, tmp_path)
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [each[0] for each in cells] == ["dxb `learn.act`", "LeRobot 0.4.4 act"]
    assert all("/1" in each[3] for each in cells)
