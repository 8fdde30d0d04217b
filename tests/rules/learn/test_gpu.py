"""Training on a GPU: as on the CPU but for rounding, and the same bytes each time. `make test-gpu` runs these tests.

Those of worlds need MuJoCo Warp, too, the extra `batch`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dextera_build.artifacts.tasks.task import Reset
from dextera_build.sim.training.tensors.worlds import TensorWorlds
from tests import episodes, task_bundles
from tests.benchmarks.worlds import tensors as measured
from tests.rules.learn import test_ppo_warp as worlds
from tests.rules.learn.test_act import ACT
from tests.rules.learn.test_bc_rnn import RNN
from tests.rules.learn.test_diffusion import DIFFUSION
from tests.rules.learn.trainings import Trainings

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
ALL = pytest.mark.parametrize("kind", [ACT, DIFFUSION, RNN], ids=lambda kind: kind.rule)


@ALL
def test_the_same_inputs_give_the_same_bytes(kind: Trainings, tmp_path: Path) -> None:
    data = episodes.small(4)
    assert kind.learn(tmp_path, data, "cuda").weights == kind.learn(tmp_path, data, "cuda").weights


@ALL
def test_bfloat16_learns_the_same(kind: Trainings, tmp_path: Path) -> None:
    data = episodes.small(4)
    plain, fast = (kind.learn(tmp_path, data, "cuda", steps=8, bf16=bf16) for bf16 in (False, True))
    assert fast.weights != plain.weights
    np.testing.assert_allclose(fast.curve, plain.curve, rtol=0.1)


@ALL
def test_the_losses_are_those_of_the_cpu(kind: Trainings, tmp_path: Path) -> None:
    """Over few steps, because every step amplifies differences of rounding."""
    data = episodes.small(4)
    here, there = (kind.learn(tmp_path, data, backend, steps=8) for backend in ("torch", "cuda"))
    np.testing.assert_allclose(there.curve, here.curve, rtol=1e-2)


@ALL
def test_a_training_that_was_killed_ends_with_the_same_bytes(
    kind: Trainings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind.assert_resumes(tmp_path, monkeypatch, "cuda")


@pytest.fixture
def warp() -> None:
    pytest.importorskip("mujoco_warp")


@pytest.mark.usefixtures("warp")
def test_worlds_are_those_of_the_cpu(tmp_path: Path) -> None:
    """From the same starts, for the first decisions: contacts amplify differences of rounding."""
    bundle = task_bundles.lift(reset=Reset(position_m=0.004, dynamics=1.0, joints=1.0))
    contract = worlds.contract(tmp_path, bundle)
    here, there = (TensorWorlds(bundle, contract, 6, 0, pool=1, device=device) for device in ("cpu", "cuda"))
    decisions = torch.rand(6, here.decisions, generator=torch.Generator().manual_seed(0)) * 2 - 1
    for _ in range(3):
        one, other = here.step(decisions), there.step(decisions.cuda())
        np.testing.assert_allclose(other.seen.cpu(), one.seen, atol=1e-3)
        np.testing.assert_allclose(other.rewards.cpu(), one.rewards, atol=1e-3)


@pytest.mark.usefixtures("warp")
def test_practice_in_many_worlds_gives_the_same_bytes(tmp_path: Path) -> None:
    one, other = (worlds.learn(tmp_path, "cuda", worlds=64, batch=64, steps=512) for _ in range(2))
    assert one.weights == other.weights


@pytest.mark.usefixtures("warp")
def test_practice_that_was_killed_ends_with_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = worlds.interrupted(tmp_path / "plain", None, monkeypatch, "cuda")
    assert worlds.interrupted(tmp_path / "cut", 8, monkeypatch, "cuda") is None
    again = worlds.interrupted(tmp_path / "cut", None, monkeypatch, "cuda")
    assert plain is not None
    assert again is not None
    assert again.weights == plain.weights


@pytest.mark.usefixtures("warp")
def test_a_decision_copies_nothing_to_the_host(tmp_path: Path) -> None:
    """Torch raises an error at an operation that waits for the GPU."""
    bundle = task_bundles.lift()
    made = TensorWorlds(bundle, worlds.contract(tmp_path, bundle), 64, 0, pool=4, device="cuda")
    with made.here():
        decisions = torch.zeros(64, made.decisions, device="cuda")
        made.step(decisions)  # constants are copied to the GPU at their first use
        torch.cuda.set_sync_debug_mode("error")
        try:
            made.step(decisions)
        finally:
            torch.cuda.set_sync_debug_mode("default")


@pytest.mark.usefixtures("warp")
def test_training_is_measured_on_the_gpu() -> None:
    found = measured.measured(task_bundles.lift(), 1024, "cuda", rollout=4, rounds=2)
    print(measured.row("LiftBox", "cuda", 1024, found))
    assert 0 < found.physics_s < found.learning_s
