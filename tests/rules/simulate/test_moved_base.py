"""simulate.moved_base: the robot stands elsewhere, and all else stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, factories, gate, task_bundles


def moved(folder: Path, bundle: TaskBundle, base: np.ndarray) -> TaskBundle:
    made = RuleRunner(folder).run("simulate.moved_base", bundle=bundle, base=factories.placed(base, "base"))
    assert isinstance(made, TaskBundle)
    return made


def leaning(bundle: TaskBundle) -> np.ndarray:
    """The base of a bundle, moved and leaning as a calibration finds it."""
    turn = np.array([[1.0, 0.0, 0.02], [0.0, 1.0, -0.01], [-0.02, 0.01, 1.0]])
    rotation = np.linalg.svd(turn)[0] @ np.linalg.svd(turn)[2]
    return np.asarray(bundle.base_pose.matrix @ transforms.rigid(rotation, np.array([0.004, -0.012, 0.003])))


# The base of a composed task is in a frame of its own, that of the gate is placed itself.
@pytest.mark.parametrize("make", [task_bundles.lift, gate.bundle])
def test_the_robot_moves_and_nothing_else(tmp_path: Path, make) -> None:
    before = make()
    base = leaning(before)
    after = moved(tmp_path, before, base)
    assert after.base_pose.matrix == pytest.approx(base)
    one, other = Environment(before), Environment(after)
    shift = base @ transforms.invert(before.base_pose.matrix)
    for number in range(1, one.model.nbody):
        name = one.model.body(number).name
        places = [transforms.rigid(e.data.xmat[number].reshape(3, 3), e.data.xpos[number]) for e in (one, other)]
        expected = shift @ places[0] if name.startswith(ROBOT) else places[0]
        # The gate's link stands on the world's vertical, not on its base.
        if name != f"{ROBOT}link":
            assert places[1] == pytest.approx(expected, abs=1e-6), name
    assert after.task == before.task
    assert after.objects.keys() == before.objects.keys()
    assert np.array_equal(one.start.qpos, other.start.qpos)


def test_what_is_far_from_the_task_s_own_place_is_said(tmp_path: Path) -> None:
    runner, bundle = RuleRunner(tmp_path), gate.bundle()
    near = factories.placed(leaning(bundle), "base")
    runner.run("simulate.moved_base", bundle=bundle, base=near)
    assert runner.outcome.warnings == []
    assert runner.outcome.line == "base moved by 13.0 mm and 1.28 deg"
    far = factories.placed(bundle.base_pose.matrix @ factories.pose(x=0.3), "base")
    runner.run("simulate.moved_base", bundle=bundle, base=far)
    assert runner.outcome.warnings == [
        "the base is 300 mm and 0.0 deg from where the task was planned: look at the calibration, or make the task"
        " again with `base` of `simulate.task`"
    ]


def test_other_worlds_and_other_frames_are_refused(tmp_path: Path) -> None:
    runner, bundle = RuleRunner(tmp_path), gate.bundle("reference")
    base = factories.placed(bundle.base_pose.matrix, "base")
    with pytest.raises(RuleError, match="the base is moved in a twin, but this task is in a reference world"):
        runner.run("simulate.moved_base", bundle=bundle, base=base)
    wrong = factories.placed(bundle.base_pose.matrix, "base", "camera")
    with pytest.raises(RuleError, match="the base is T_camera_base, but T_world_base is needed"):
        runner.run("simulate.moved_base", bundle=gate.bundle(), base=wrong)


def test_a_model_without_the_robot_stays_as_it_is(tmp_path: Path) -> None:
    """As the stub of simulate.task makes it."""
    plain = Folder(files={"scene.xml": b"<mujoco><worldbody/></mujoco>"})
    bundle = episodes.bundle().model_copy(update={"model": plain})
    after = moved(tmp_path, bundle, leaning(bundle))
    assert b"pos" not in after.model.files["scene.xml"]
