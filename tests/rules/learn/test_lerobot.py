"""learn.lerobot: LeRobot's command line, its checkpoints and its failures, with a stand-in for LeRobot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.learning import packed
from dextera_build.testing import RuleRunner
from rules.learn.outside.programs.lerobot_ranges import linked
from tests import episodes
from tests.rules.learn import stand_in

BUNDLE = episodes.bundle()
SMALL = {"steps": 8, "save_every": 4, "batch": 2, "workers": 0}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A data set of states."""
    made: Folder = RuleRunner(tmp_path_factory.mktemp("data")).run(
        "demonstrate.lerobot", bundle=BUNDLE, episodes=episodes.small(2, 6, seed=1)
    )
    return made


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with the stand-in for LeRobot."""
    stand_in.environment(tmp_path, "lerobot", stand_in.LEROBOT)
    return tmp_path


def trained(project: Path, data: Folder, **options: Any) -> tuple[Checkpoint, RuleRunner]:
    inputs = {name: options.pop(name) for name in ("base", "bundle") if name in options}
    (project / "scratch").mkdir(exist_ok=True)
    runner = RuleRunner(project / "scratch", project=project, keep=project / "keep")
    made = runner.run(
        "learn.lerobot", backend="own", options=SMALL | options, **({"bundle": BUNDLE, "data": data} | inputs)
    )
    assert isinstance(made, Checkpoint)
    return made, runner


def refused(project: Path, data: Folder, **options: Any) -> DxbError:
    with pytest.raises(DxbError) as caught:
        trained(project, data, **options)
    return caught.value


def calls(project: Path) -> list[list[str]]:
    """Arguments of every run of the trainer, whose folder survives a failure."""
    return [line.split() for line in (project / "keep" / "calls.txt").read_text().splitlines()]


@pytest.mark.medium
def test_the_policy_is_that_of_the_last_checkpoint(project: Path, data: Folder, tmp_path: Path) -> None:
    made, runner = trained(project, data, policy={"chunk_size": 4, "use_vae": False, "down_dims": [8, 16]})
    assert made.steps.tolist() == list(range(1, 9))
    np.testing.assert_allclose(made.curve, 1 / np.arange(1, 9), atol=1e-3)
    contract = made.contract
    assert [channel.name for channel in contract.inputs] == ["joints", "objects", "displacement", "goal"]
    assert {channel.encoding for channel in contract.inputs} == {"plain"}
    assert not any(channel.mean for channel in (*contract.inputs, contract.action))
    assert contract.settings["version"] == "0.4.4"
    assert contract.settings["instruction"] == "lift box"
    assert json.loads(str(contract.settings["features"]))["observation.environment_state"] == [
        "objects",
        "displacement",
    ]
    packed.unpack(made.weights, tmp_path / "out")
    files = {path.name: path.read_text() for path in (tmp_path / "out").iterdir()}
    assert files["model.safetensors"] == "weights of step 8"
    # Neither pickles nor folders of this machine.
    assert files.keys() == {"config.json", "model.safetensors", "policy_preprocessor.json"}
    assert json.loads(files["config.json"]) == {"type": "act", "pretrained_path": None}
    assert "act of LeRobot 0.4.4" in runner.outcome.line


def test_options_become_arguments_of_the_trainer(project: Path, data: Folder) -> None:
    fault = {"chunk_size": 4, "use_vae": False, "down_dims": [8, 16], "fault": "exit:1"}
    refused(project, data, policy=fault, trainer={"dataset.image_transforms.enable": True}, seed=3)
    ((_, *words),) = calls(project)
    assert f"--dataset.root={project / 'keep' / 'data'}" in words
    assert {"--policy.type=act", "--policy.chunk_size=4", "--policy.use_vae=false"} <= set(words)
    assert {"--steps=8", "--batch_size=2", "--seed=3", "--policy.device=cpu"} <= set(words)
    assert "--dataset.image_transforms.enable=true" in words
    assert f"--output_dir={project / 'keep' / 'run'}" in words


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_joint_that_stays_still_is_scaled_by_the_least_range(tmp_path: Path, version: str) -> None:
    """Only copied statistics are widened, and only those of numbers with a small range over the whole set."""
    shown = episodes.small(3, 6, seed=1)
    still = [np.where(np.arange(3) == 1, np.float32(0.3), one.action) for one in shown.items.values()]
    still[0][:, 2] = 0.1  # in one episode alone
    items = {
        name: one.model_copy(update={"action": moved})
        for (name, one), moved in zip(shown.items.items(), still, strict=True)
    }
    made = RuleRunner(tmp_path).run(
        "demonstrate.lerobot",
        bundle=BUNDLE,
        episodes=shown.model_copy(update={"items": items}),
        options={"version": version},
    )
    made.export(tmp_path / "data", "data")
    before = json.loads((tmp_path / "data" / "meta" / "stats.json").read_text())
    folder = linked(tmp_path / "data", tmp_path / "linked", 0.01)
    assert json.loads((tmp_path / "data" / "meta" / "stats.json").read_text()) == before
    after = json.loads((folder / "meta" / "stats.json").read_text())
    own, wide = before["action"], after["action"]
    assert (own["std"][1], own["q01"][1]) == pytest.approx((0.0, 0.3), abs=1e-6)
    for low, high in (("min", "max"), ("q01", "q99"), ("q10", "q90")):
        assert (wide[low][1], wide[high][1]) == pytest.approx((0.295, 0.305), abs=1e-6)
        assert (wide[low][2], wide[high][2]) == (own[low][2], own[high][2])
    assert wide["std"] == [own["std"][0], 0.0025, own["std"][2]]
    assert after["timestamp"] == before["timestamp"]
    assert {path.name for path in folder.iterdir()} == {path.name for path in (tmp_path / "data").iterdir()}
    if version == "v2.1":
        rows = [json.loads(line) for line in (folder / "meta" / "episodes_stats.jsonl").read_text().splitlines()]
        assert [row["stats"]["action"]["std"][1] for row in rows] == [0.0025] * 3
        assert rows[0]["stats"]["action"]["std"][2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.medium
def test_a_killed_training_goes_on_after_its_last_checkpoint(project: Path, data: Folder) -> None:
    error = refused(project, data, policy={"fault": "once:7"})
    assert "signal 11" in error.message
    made, _ = trained(project, data, policy={"fault": "once:7"})
    assert made.steps.tolist() == list(range(1, 9))
    assert b"weights of step 8" in made.weights


@pytest.mark.medium
def test_the_second_run_is_told_to_resume(project: Path, data: Folder) -> None:
    refused(project, data, policy={"fault": "exit:7"})
    refused(project, data, policy={"fault": "exit:7"})
    first, second = calls(project)
    assert (first[0], second[0]) == ("0", "4")
    assert "--resume=true" in second
    assert any(word.startswith("--config_path=") and "/000004/" in word for word in second)
    assert not any(word.startswith("--policy.type") for word in second)


FAULTS = {
    "exit:3": ("failed (exit code 1):", "ValueError: the embedding dimension is not divisible", "dxb log"),
    "memory:3": ("ran out of memory", "CUDA out of memory. Tried to allocate 2.00 GiB.", "a smaller `batch`"),
    "module:3": ("failed (exit code 1)", "No module named 'diffusers'", "install the package in the environment"),
    "nan:3": ("the loss of LeRobot's trainer is not a number after 3 steps", "", "a smaller learning rate"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_failure_is_told_with_what_the_trainer_said(fault: str, project: Path, data: Folder) -> None:
    error = refused(project, data, policy={"fault": fault})
    message, said, hint = FAULTS[fault]
    assert error.code == "DXB-B378"
    assert message in error.message
    assert said in error.message
    assert hint in str(error.hint)


def test_an_unknown_kind_is_told_with_those_that_there_are(project: Path, data: Folder) -> None:
    error = refused(project, data, type="diffusoin")
    assert error.message == "LeRobot 0.4.4 has no policy `diffusoin`"
    assert str(error.hint).endswith("one of act, pi05")


def test_a_data_set_of_another_version_is_refused(project: Path, tmp_path: Path) -> None:
    old = RuleRunner(tmp_path).run(
        "demonstrate.lerobot", bundle=BUNDLE, episodes=episodes.small(2, 6, seed=1), options={"version": "v2.1"}
    )
    error = refused(project, old)
    assert error.message == "the data set has version v2.1, LeRobot 0.4.4 reads v3.0"
    assert error.hint == "`version: v3.0` of demonstrate.lerobot"


def test_a_missing_environment_is_told_with_the_next_step(tmp_path: Path, data: Folder) -> None:
    error = refused(tmp_path, data)
    assert isinstance(error, MachineError)
    assert ".envs/lerobot" in str(error.facts["needs"])
    assert "python -m venv .envs/lerobot" in str(error.hint)


def test_a_data_set_of_another_task_or_rate_is_refused(project: Path, data: Folder) -> None:
    about = json.loads(data.files["meta/dextera.json"])
    about["action"]["rate_hz"] = 50.0
    about["action"]["kind"] = "end_effector"
    files = {**data.files, "meta/dextera.json": json.dumps(about).encode()}
    error = refused(project, Folder(files=files))
    assert error.code == "DXB-B503"
    assert set(error.facts) == {"another rate", "another kind of action"}
    error = refused(project, Folder(files={"a.txt": b""}))
    assert "no `meta/dextera.json`" in error.message


def test_an_observation_that_the_task_does_not_give_is_refused(project: Path, data: Folder) -> None:
    info = json.loads(data.files["meta/info.json"])
    info["features"]["observation.images.wrist"] = {"dtype": "video", "shape": [48, 64, 3], "names": []}
    error = refused(project, Folder(files={**data.files, "meta/info.json": json.dumps(info).encode()}))
    assert error.code == "DXB-B530"
    assert "observation.images.wrist" in error.message
    assert error.facts == {"data set": "64 x 48 px", "task": "no view"}
    info["features"]["observation.images.wrist"] |= {"dtype": "image", "info": {"is_depth_map": True}}
    error = refused(project, Folder(files={**data.files, "meta/info.json": json.dumps(info).encode()}))
    assert error.facts == {"data set": "depth", "task": "colours alone, for these trainers"}


@pytest.mark.medium
def test_a_pretrained_policy_is_where_the_training_begins(project: Path, data: Folder) -> None:
    base = Folder(files={"config.json": b'{"type": "act"}', "model.safetensors": b"x"})
    made, _ = trained(project, data, base=base)
    assert len(str(made.contract.settings["base"])) == 64
    refused(project, data, base=base, policy={"fault": "exit:1"})
    ((_, *words),) = calls(project)
    assert any(word.startswith("--policy.path=") for word in words)
    other = Folder(files={**base.files, "config.json": b'{"type": "pi05"}'})
    assert refused(project, data, base=other).hint == "type: pi05"


def test_packed_files_stay_in_their_folder(tmp_path: Path) -> None:
    packed.unpack(packed.to_bytes({"a/b.json": b"{}"}), tmp_path / "in")
    assert (tmp_path / "in" / "a" / "b.json").read_bytes() == b"{}"
    for wrong in (packed.to_bytes({"../b": b""}), b"no safetensors"):
        with pytest.raises(RuleError) as caught:
            packed.unpack(wrong, tmp_path / "in")
        assert caught.value.code == "DXB-B528"
