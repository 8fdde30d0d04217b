"""The program that measures many worlds beside MuJoCo alone, on a small task whose physics is so cheap that all shows.

`python -m tests.benchmarks.worlds cache/out/task/kl/lift_mustard_bottle/task/task.bundle` measures built ones.
"""

from __future__ import annotations

import pytest

from tests import task_bundles
from tests.benchmarks.worlds import __main__ as program
from tests.benchmarks.worlds import measure, tensors

pytestmark = pytest.mark.slow


def test_a_row_has_a_cell_for_every_column() -> None:
    found = measure.measured(task_bundles.lift(), 3, 2, 3)
    assert all(len(part) == 3 for times in (found.ours, found.alone, found.rollout, found.practice) for part in times)
    cells = [cell.strip() for cell in program.row("small", found).strip("|").split("|")]
    assert len(cells) == len(program.HEADS)
    assert cells[:2] == ["`small`", "3"]
    assert 5 < float(cells[5].rstrip(" %")) < 100
    assert float(cells[2].replace(",", "")) > 0


def test_every_round_ends_some_episodes() -> None:
    """Otherwise nothing would be said about resets."""
    from dextera_build.sim.training.vector import TaskVectorEnv

    several = TaskVectorEnv(task_bundles.lift(), 4, threads=1)
    several.reset(seed=0)
    measure._spread(several)
    over = [several.step(several.action_space.sample())[3].sum() for _ in range(80)]
    assert sum(over) == 4
    assert max(over) == 1
    several.close()


def test_a_row_of_a_training_has_a_cell_for_every_column() -> None:
    """Needs the extra `batch`."""
    pytest.importorskip("mujoco_warp")
    found = tensors.measured(task_bundles.lift(), 2, "cpu", rollout=2, rounds=1)
    assert (found.decisions, found.every) == (4, 4)
    assert found.physics_s > 0.0
    assert 0.0 < found.practice_s < found.learning_s
    cells = [cell.strip() for cell in tensors.row("small", "cpu", 2, found).strip("|").split("|")]
    assert len(cells) == len(tensors.HEADS)
