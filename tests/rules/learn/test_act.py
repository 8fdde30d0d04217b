"""learn.act: what it learns, that it is exact, and that an interruption loses nothing."""

from __future__ import annotations

import errno
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from pydantic import ValidationError

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.errors import MachineError, RuleError
from dextera_build.learning import weights
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame, Measurement, deployable
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy import policies
from tests.policy.policies import load
from tests.rules.learn.trainings import BUNDLE, FEW, Trainings, filmed, miss

ACT = Trainings("learn.act", {"steps": 30, "width": 16, "heads": 2, "chunk": 5, "batch": 16, "held_out": 0.25})
learn, interrupted = ACT.learn, ACT.interrupted


@pytest.mark.slow
def test_it_learns_what_was_shown(tmp_path: Path) -> None:
    """A policy that saw 16 swings towards a box reaches boxes that stand elsewhere."""
    made = learn(tmp_path, episodes.small(16, 30), steps=500, width=32, batch=32)
    assert made.curve[-1] < 0.2 * made.curve[0]
    assert miss(made) < 0.1


@pytest.mark.medium
def test_the_same_inputs_give_the_same_bytes(tmp_path: Path) -> None:
    data = episodes.small(4)
    first = learn(tmp_path, data)
    assert learn(tmp_path, data).weights == first.weights
    assert learn(tmp_path, data, seed=1).weights != first.weights


@pytest.mark.medium
def test_neither_threads_nor_the_global_generator_matter(tmp_path: Path) -> None:
    import torch

    data, before = episodes.small(4), torch.get_num_threads()
    first = learn(tmp_path, data)
    torch.set_num_threads(2)
    torch.manual_seed(7)
    try:
        state = torch.get_rng_state()
        assert learn(tmp_path, data).weights == first.weights
        assert torch.equal(torch.get_rng_state(), state)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.medium
@pytest.mark.parametrize(
    "more",
    [
        {"jitter": 0.02},
        pytest.param({"average": 0.9, "snapshot_every": 5}, marks=pytest.mark.slow),
        pytest.param({"bf16": True}, marks=pytest.mark.slow),
        pytest.param({"inputs": ("joints", "rgb"), "steps": 12}, marks=pytest.mark.slow),
    ],
)
def test_a_training_that_was_killed_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]
) -> None:
    ACT.assert_resumes(tmp_path, monkeypatch, **more)


@pytest.mark.slow
def test_a_compiled_training_gives_about_the_same_weights(tmp_path: Path) -> None:
    data = episodes.small(4)
    plain, made = (learn(tmp_path, data, steps=4, compiled=compiled) for compiled in (False, True))
    first, second = (weights.from_bytes(each.weights) for each in (plain, made))
    assert first.keys() == second.keys()
    np.testing.assert_allclose(plain.curve, made.curve, rtol=1e-3)
    assert [path for path in tmp_path.rglob("compiled") if any(path.rglob("*.so"))], (
        "its code lies in the node's folder"
    )


@pytest.mark.medium
def test_a_missing_compiler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from torch._inductor import config

    monkeypatch.setattr(config.cpp, "cxx", ("no-such-compiler",))
    with pytest.raises(MachineError, match="the network could not be compiled") as caught:
        learn(tmp_path, episodes.small(4), compiled=True)
    assert "C++ compiler" in str(caught.value.hint)
    assert learn(tmp_path, episodes.small(4)).weights, "without it"


@pytest.mark.slow
def test_the_state_of_another_training_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = episodes.small(4)
    interrupted(tmp_path, data, 7, monkeypatch)
    _, lines = interrupted(tmp_path, data, None, monkeypatch, seed=1)
    assert not [line for line in lines if line.startswith("resumes")]


@pytest.mark.slow
def test_a_damaged_state_begins_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = episodes.small(4)
    whole, _ = interrupted(tmp_path / "whole", data, None, monkeypatch)
    interrupted(tmp_path / "cut", data, 7, monkeypatch)
    (file,) = (tmp_path / "cut" / "keep").iterdir()
    file.write_bytes(file.read_bytes()[:-10])
    rest, lines = interrupted(tmp_path / "cut", data, None, monkeypatch)
    assert not [line for line in lines if line.startswith("resumes")]
    assert rest.weights == whole.weights


@pytest.mark.slow
def test_a_training_whose_snapshot_was_lost_begins_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = episodes.small(4)
    whole, _ = interrupted(tmp_path / "whole", data, None, monkeypatch, average=0.9, snapshot_every=5)
    assert list(whole.snapshots) == ["5", "10"]
    assert len({*whole.snapshots.values(), whole.weights}) == 3
    interrupted(tmp_path / "cut", data, 11, monkeypatch, average=0.9, snapshot_every=5)
    (lost,) = (tmp_path / "cut" / "keep").glob("*-5.safetensors")
    lost.unlink()
    rest, lines = interrupted(tmp_path / "cut", data, None, monkeypatch, average=0.9, snapshot_every=5)
    assert not [line for line in lines if line.startswith("resumes")]
    assert rest.snapshots == whole.snapshots


@pytest.mark.medium
def test_a_full_disk_does_not_end_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = episodes.small(4)
    whole, _ = interrupted(tmp_path / "whole", data, None, monkeypatch)

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    made, lines = interrupted(tmp_path / "full", data, None, monkeypatch)
    assert "the state of the training could not be kept: No space left on device" in lines
    assert made.weights == whole.weights


def test_dropout_is_drawn_from_the_seed(tmp_path: Path) -> None:
    data = episodes.small(4)
    first = learn(tmp_path, data, dropout=0.2, steps=5)
    assert learn(tmp_path, data, dropout=0.2, steps=5).weights == first.weights
    assert learn(tmp_path, data, steps=5).weights != first.weights
    policy = load(first, BUNDLE)
    assert np.array_equal(policy.act(policies.observation()), load(first, BUNDLE).act(policies.observation()))


@pytest.mark.parametrize(
    ("says", "message"),
    [
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"), "the GPU has too little memory"),
        (RuntimeError("[enforce fail at alloc_cpu.cpp] DefaultCPUAllocator: not enough"), "memory is used up"),
    ],
)
def test_a_step_that_does_not_fit_into_memory_tells_the_batch(tmp_path, monkeypatch, says, message) -> None:
    def full(*_: object, **__: object) -> None:
        raise says

    monkeypatch.setattr(torch.nn.utils, "clip_grad_norm_", full)
    with pytest.raises(MachineError, match=message) as caught:
        learn(tmp_path, episodes.small(3), batch=32)
    assert str(caught.value.hint).startswith("`batch: 16`, or ")


def test_a_training_that_diverges_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the training diverged before step") as caught:
        learn(tmp_path, episodes.small(4), rate=1e30)
    assert caught.value.hint == "rate: 3e+29"


def test_privileged_quantities_full_of_nan_leave_the_weights_alone(tmp_path: Path) -> None:
    data = episodes.small(4)

    def poison(one: Episode) -> Episode:
        hand, contact = (np.full_like(each, np.nan) for each in (one.hand, one.contact))
        return episodes.observed(one.model_copy(update={"hand": hand}), contact=contact)

    poisoned = data.model_copy(update={"items": {name: poison(one) for name, one in data.items.items()}})
    assert learn(tmp_path, poisoned, **FEW).weights == learn(tmp_path, data, **FEW).weights


def test_labels_are_what_was_meant_and_not_what_was_sent(tmp_path: Path) -> None:
    data = episodes.small(4)
    noisy = {
        name: one.model_copy(update={"executed": one.executed + np.float32(0.1)}) for name, one in data.items.items()
    }
    learned = [learn(tmp_path, each, **FEW).weights for each in (data, data.model_copy(update={"items": noisy}))]
    assert learned[0] == learned[1]


@pytest.mark.medium
def test_the_normalisation_comes_from_training_episodes_alone(tmp_path: Path) -> None:
    data = episodes.small(4)
    far = {name: episodes.observed(one, joints=one.joints + np.float32(5.0)) for name, one in data.items.items()}
    plain = learn(tmp_path, data, **FEW).contract.inputs[0]
    changed = [data.model_copy(update={"items": data.items | {name: far[name]}}) for name in data.items]
    means = [learn(tmp_path, each, **FEW).contract.inputs[0].mean for each in changed]
    assert sum(mean == plain.mean for mean in means) == 1, "one of four episodes is held out"


def test_the_contract_says_all_that_it_was_trained_on(tmp_path: Path) -> None:
    data = episodes.small(4)
    contract = learn(tmp_path, data, objects="all", **FEW).contract
    assert contract.task == "LiftBox"
    assert contract.embodiment == data.embodiment
    assert contract.rate_hz == data.rate_hz
    assert contract.action.names == data.joint_names
    assert [(channel.name, channel.names) for channel in contract.inputs] == [
        ("joints", data.joint_names),
        ("objects", ("box", "case")),
        ("displacement", ("case_lid_hinge",)),
        ("goal", ("rise",)),
    ]
    assert contract.dataset != learn(tmp_path, episodes.small(5), **FEW).contract.dataset


def test_it_looks_at_the_object_of_the_task_alone(tmp_path: Path) -> None:
    contract = learn(tmp_path, episodes.small(4), **FEW).contract
    named = {channel.name: channel.names for channel in contract.inputs}
    assert named == {"joints": ("joint_1", "joint_2", "joint_3"), "objects": ("box",), "goal": ("rise",)}


@pytest.mark.medium
def test_it_learns_from_pictures(tmp_path: Path) -> None:
    data = episodes.small(6)
    made = learn(tmp_path, data, inputs=("joints", "rgb"), film=filmed(data), steps=60)
    assert made.contract.inputs[1].shape == (32, 48, 3)
    assert made.curve[-1] < 0.5 * made.curve[0]
    assert {"eyes", "locate"} <= {name.partition(".")[0] for name in weights.from_bytes(made.weights)}
    assert "objects" not in {channel.name for channel in made.contract.inputs}


def test_where_objects_are_is_told_in_training_alone(tmp_path: Path) -> None:
    """The tracked pose teaches a policy that looks to find the object; at run time it is not asked for."""
    data = episodes.small(4)
    made = learn(tmp_path, data, inputs=("joints", "rgb"), film=filmed(data), **FEW)
    assert made.contract.settings["located"] == 9
    policy = load(made, BUNDLE, episodes.view(48, 32))
    joints, picture = data.items["0"].joints[0], np.zeros((32, 48, 3), np.uint8)
    tracked = [np.full((2, 7), fill) for fill in (0.5, np.nan)]
    seen = [Measurement(joints, objects, np.zeros(1), {PICTURE: Frame(rgb=picture)}) for objects in tracked]
    acted = [policy.act(deployable(one, joints, np.ones(1))) for one in seen]
    assert np.isfinite(acted).all()


def test_the_stub_gives_a_checkpoint_of_the_same_form(tmp_path: Path) -> None:
    data = episodes.small(4)
    stub, real = (learn(tmp_path, data, backend=backend, **FEW) for backend in ("stub", "torch"))
    assert stub.contract == real.contract
    assert stub.curve_name == real.curve_name
    with pytest.raises(RuleError, match="the weights do not fit the network"):
        load(stub, BUNDLE)


@pytest.mark.medium
def test_it_reports_loss_and_curve(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    runner.run("learn.act", bundle=BUNDLE, episodes=episodes.small(4), options=dict(ACT.small))
    assert runner.outcome.line.startswith("3 episodes, 30 steps, loss 0.")
    assert runner.outcome.metrics["held-out error"][1] == "mrad"
    ((caption, picture),) = runner.outcome.previews
    assert caption == "loss over 30 steps, 3 episodes"
    assert Image.open(io.BytesIO(picture)).size == (640, 280)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({"items": {}}, {}, "no episode succeeded, so there is nothing to learn from"),
        ({}, {"inputs": ("joints", "rgb")}, "there is no channel `rgb` to learn from"),
        ({}, {"inputs": ("displacement",)}, "none of the inputs has a component: displacement"),
        ({}, {"width": 18, "heads": 4}, "width 18 is not a multiple of 4 heads"),
        ({}, {"every": 6}, "every 6 is more than the 5 steps of a chunk"),
        ({"rate_hz": 10.0}, {}, "the data set does not fit the task bundle: another rate"),
    ],
)
def test_bad_input_is_one_clear_error(
    tmp_path: Path, change: dict[str, Any], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(RuleError, match=message):
        learn(tmp_path, episodes.small(4).model_copy(update=change), **options)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ((), "`inputs` must name one channel or more, each once"),
        (("joints", "joints"), "`inputs` must name one channel or more, each once"),
        (
            ("joints", "contact"),
            "`contact` is privileged: only a simulator measures it; `inputs` may name cloud, depth, displacement",
        ),
        (
            ("joints", "object"),
            "`object` is no channel that this policy can take; `inputs` may name cloud, depth, displacement, goal",
        ),
    ],
)
def test_inputs_that_no_robot_measures_are_refused_before_anything_is_built(
    tmp_path: Path, inputs: tuple[str, ...], message: str
) -> None:
    kind = RuleRunner(tmp_path).find("learn.act").rule.options
    with pytest.raises(ValidationError, match=message):
        kind.model_validate({"inputs": inputs})


def test_a_film_must_belong_to_the_episodes(tmp_path: Path) -> None:
    data = episodes.small(4)
    film = filmed(data)
    with pytest.raises(RuleError, match="a film is given, but none of cloud, depth, rgb is among the inputs"):
        learn(tmp_path, data, film=film)
    part = film.model_copy(update={"frames": {"0": film.frames["0"]}})
    with pytest.raises(RuleError, match="the film lacks 3 of 4 episodes"):
        learn(tmp_path, data, film=part, inputs=("joints", "rgb"))
    longer = filmed(episodes.small(4, 25))
    with pytest.raises(RuleError, match="episode `0` has 20 steps, but 25 frames"):
        learn(tmp_path, data, film=longer, inputs=("joints", "rgb"))
