"""learn.ppo in worlds of MuJoCo Warp: the worlds are those of MuJoCo, and what is trained there works in MuJoCo.

Needs the extra `batch`; Warp compiles its kernels at their first use, which takes a minute.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.errors import MachineError, RuleError
from dextera_build.rule import Context
from dextera_build.rule.pretrained import Device, Pretrained
from dextera_build.sim.training.practice import Practices
from dextera_build.sim.training.tensors.worlds import TensorWorlds
from dextera_build.testing import RuleRunner
from tests import task_bundles
from tests.rules.learn.trainings import Killed
from tests.sim.runtime.test_batch import PLAN

SMALL = {"steps": 16, "worlds": 2, "rollout": 4, "batch": 4, "epochs": 2, "width": 16, "every": 1, "warp": {"pool": 3}}
DEVICE: Device = "cpu"


def coarse(bundle: TaskBundle) -> TaskBundle:
    """The same in steps of 10 ms, so that the kernels of a control period are launched less often."""
    files = {name: each.replace(b"<option ", b'<option timestep="0.01" ') for name, each in bundle.model.files.items()}
    return bundle.model_copy(update={"model": Folder(files=files)})


BUNDLE = coarse(task_bundles.close(reset=Reset(position_m=0.01, joint_rad=0.1, robot_rad=0.005)))


def contract(tmp_path: Path, bundle: TaskBundle, **options: Any) -> PolicyContract:
    made = RuleRunner(tmp_path).run("learn.ppo", backend="stub", bundle=bundle, options=options)
    assert isinstance(made, Checkpoint)
    return made.contract


def learn(tmp_path: Path, device: Device = DEVICE, **more: Any) -> Checkpoint:
    runner = RuleRunner(tmp_path, gpu_gb=80.0 if device == "cuda" else 0.0)
    made = runner.run("learn.ppo", backend="warp", bundle=BUNDLE, options=SMALL | more)
    assert isinstance(made, Checkpoint)
    return made


def interrupted(
    folder: Path, stop: int | None, monkeypatch: pytest.MonkeyPatch, device: Device = DEVICE
) -> Checkpoint | None:
    """A training that is killed after `stop` decisions, or goes on after that."""
    found = RuleRunner(folder).find("learn.ppo")
    module = found.backends["warp"].module
    monkeypatch.setattr(f"{module.Training.__module__}.SAVE_EVERY_S", 0.0)

    def emit(kind: str, event: Mapping[str, object]) -> None:
        if kind == "progress" and event["done"] == stop:
            raise Killed

    options = {name: value for name, value in SMALL.items() if name != "warp"}
    keep, pretrained = folder / "keep", Pretrained(device=device)
    own = module.WarpOptions(pool=3)
    ctx = Context(module, own, scratch=folder / "scratch", emit=emit, keep=keep, pretrained=pretrained)
    try:
        made = found.rule(ctx, BUNDLE, options=found.rule.options.model_validate(options))
    except Killed:
        return None
    assert isinstance(made, Checkpoint)
    return made


def test_a_task_that_draws_its_goal_is_refused(tmp_path: Path) -> None:
    bundle = task_bundles.lift(reset=Reset(goal_m=0.02))
    with pytest.raises(RuleError) as caught:
        TensorWorlds(bundle, contract(tmp_path, bundle), 2, 0, pool=2, device=DEVICE)
    assert caught.value.code == "DXB-B535"
    assert "sb3" in str(caught.value.hint)


@pytest.mark.slow
class TestWithWarp:
    """On a CPU; `test_gpu.py` has what a GPU adds."""

    @pytest.fixture(autouse=True)
    def warp(self) -> None:
        pytest.importorskip("mujoco_warp")

    def test_worlds_are_those_of_mujoco(self, tmp_path: Path) -> None:
        """A lift with other masses, frictions and gains in each world; every second one shuts the hand too late."""
        bundle = task_bundles.lift(reset=Reset(position_m=0.004, dynamics=1.0, joints=1.0))
        options = {"control": "joints", "groups": ["arm", "hand"], "every": 1, "step_rad": 0.3}
        of = contract(tmp_path, bundle, **options)
        worlds, alone = TensorWorlds(bundle, of, 6, 0, pool=6, device=DEVICE), Practices(bundle, of, 6)
        starts, tasks = worlds.starts(), alone.worlds.tasks
        alone.worlds.begin(range(6), lambda number: tasks[number].begin(options={"start": starts[number]}))
        wanted = alone._observed(())
        np.testing.assert_allclose(worlds.seen().numpy(), wanted, atol=1e-4)
        assert len({start.mass_scale["box"] for start in starts}) > 2
        late = np.arange(6) % 2 == 1
        # Of both simulators: rewards of each episode, and the period in which it succeeded.
        earned, done = np.zeros((2, 6)), np.full((2, 6), -1)
        period = 0
        for palm, fingers, periods in PLAN:
            for _ in range(periods):
                goal = np.tile([*palm, fingers, fingers], (6, 1))
                goal[late, 3:] = 0.05 if fingers < 0.05 and palm[2] < 0.1 else goal[late, 3:]
                sent = np.array([world.previous_action for world in alone.worlds.environments])
                decisions = ((goal - sent) / 0.3).clip(-1, 1).astype(np.float32)
                here, there = alone.step(list(decisions)), worlds.step(torch.from_numpy(decisions))
                period += 1
                results = ((here.steps.rewards, here.success), (there.rewards.numpy(), there.success.numpy()))
                for row, (rewards, success) in enumerate(results):
                    earned[row] += np.where(done[row] < 0, rewards, 0.0)
                    done[row] = np.where((done[row] < 0) & success, period, done[row])
        assert (done[0] > 0).tolist() == (done[1] > 0).tolist() == (~late).tolist()
        # Single precision feels a contact a period earlier or later.
        assert abs(done[0] - done[1]).max() <= 1
        np.testing.assert_allclose(earned[1], earned[0], atol=0.1)

    def test_a_training_that_was_killed_ends_with_the_same_bytes(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        plain = interrupted(tmp_path / "plain", None, monkeypatch)
        assert plain is not None
        assert interrupted(tmp_path / "cut", 8, monkeypatch) is None
        again = interrupted(tmp_path / "cut", None, monkeypatch)
        assert again is not None
        assert (again.weights, again.curve.tobytes()) == (plain.weights, plain.curve.tobytes())

    def test_worlds_that_fit_in_no_memory_are_one_clear_error(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        import mujoco_warp

        def make_data(*_: Any, **__: Any) -> None:
            raise RuntimeError("Failed to allocate 99 bytes on device 'cuda:0'")

        monkeypatch.setattr(mujoco_warp, "make_data", make_data)
        with pytest.raises(MachineError) as caught:
            learn(tmp_path, worlds=8)
        assert (caught.value.code, caught.value.hint) == ("DXB-E389", "worlds: 4")

    def test_a_teacher_that_practised_there_teaches_in_mujoco(self, tmp_path: Path) -> None:
        made = learn(tmp_path, privileged=True)
        assert made.contract.settings["privileged"] > 0
        runner = RuleRunner(tmp_path, made_by={"teacher": "learn.ppo"})
        shown = runner.run("demonstrate.teach", bundle=BUNDLE, teacher=made, options={"episodes": 1})
        assert np.ptp(shown.items["00000"].action, axis=0).max() > 0.0

    def test_a_training_that_diverges_is_one_clear_error(self, tmp_path: Path) -> None:
        with pytest.raises(RuleError) as caught:
            learn(tmp_path, rate=1e30, epochs=10)
        assert caught.value.code == "DXB-B513"

    def test_it_learns_to_close_a_lid_and_its_policy_does_so_in_mujoco(self, tmp_path: Path) -> None:
        more = {"worlds": 64, "rollout": 8, "batch": 128, "epochs": 10, "every": 4, "width": 64, "warp": {"pool": 64}}
        made = learn(tmp_path, steps=12_288, **more)
        assert made.curve[-1] > made.curve[0] + 3
        runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.ppo"})
        tried = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, options={"trials": 10})
        assert tried.successes >= 5
