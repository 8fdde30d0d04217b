"""learn.openvla and learn.openpi: the command lines, tables and files of those projects, with stand-ins for clones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy import policies
from tests.rules.learn import vla_clones

BUNDLE = episodes.bundle()
VIEW = episodes.view(64, 48)


def exported(tmp_path: Path, form: str, made: Episodes, **options: Any) -> Folder:
    (tmp_path / form).mkdir()
    film = RuleRunner(tmp_path / form).run("demonstrate.film", bundle=BUNDLE, episodes=made, view=VIEW, backend="stub")
    data: Folder = RuleRunner(tmp_path / form).run(
        f"demonstrate.{form}", bundle=BUNDLE, episodes=made, film=film, view=VIEW, options=options
    )
    return data


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Folder]:
    """The data set in the forms that both read."""
    folder, made = tmp_path_factory.mktemp("sets"), episodes.small(2, 6, seed=1)
    return {"openvla": exported(folder, "rlds", made), "openpi": exported(folder, "lerobot", made, version="v2.1")}


def trained(project: Path, name: str, data: Folder, **options: Any) -> Checkpoint:
    (project / "scratch").mkdir(exist_ok=True)
    runner = RuleRunner(project / "scratch", project=project, keep=project / "keep", gpu_gb=80.0)
    made = runner.run(f"learn.{name}", backend="own", options=options, bundle=BUNDLE, data=data, view=VIEW)
    assert isinstance(made, Checkpoint)
    return made


def files(tmp_path: Path, made: Checkpoint) -> dict[str, bytes]:
    """What `learn.files` returns."""
    found: Folder = RuleRunner(tmp_path / "scratch").run("learn.files", checkpoint=made)
    return found.files


@pytest.mark.medium
def test_openvla_learns_all_joints_with_ranges_of_a_least_size(tmp_path: Path, sets: dict[str, Folder]) -> None:
    base = vla_clones.openvla(tmp_path)
    made = trained(tmp_path, "openvla", sets["openvla"], base=str(base), steps=20, batch=2, least_range_rad=0.01)
    assert made.steps.tolist() == [0, 10, 20]
    np.testing.assert_allclose(made.curve, [1, 1 / 11, 1 / 21], rtol=1e-5)
    assert [channel.name for channel in made.contract.inputs] == ["rgb"]
    assert made.contract.settings["unnorm_key"] == "lift_box"
    found = files(tmp_path, made)
    assert found.keys() == {"adapter_model.safetensors", "adapter_config.json", "dataset_statistics.json"}
    assert found["adapter_model.safetensors"] == b"adapters of step 20"
    config = json.loads(found["adapter_config.json"])
    assert config["base_model_name_or_path"] == f"sha256:{made.contract.settings['base']}"
    told = json.loads(found["dataset_statistics.json"])
    # No mask for six joints and a gripper is left; the range of a joint that moves stays, that of a still one does not.
    assert not [key for key in told["kwargs"] if key.endswith("_mask")]
    action = told["lift_box"]["action"]
    np.testing.assert_allclose((action["q01"], action["q99"]), [(-1, 0.495), (1, 0.505)])
    np.testing.assert_allclose((action["min"], action["max"]), [(-2, 0.495), (2, 0.505)])
    given = told["given"]
    assert (given["vla_path"], given["max_steps"], given["save_steps"]) == (str(base), "20", "20")
    assert (given["use_lora"], given["lora_rank"], given["learning_rate"]) == ("True", "32", "0.0005")


@pytest.mark.medium
def test_openpi_gets_a_configuration_and_goes_on_after_its_last_checkpoint(
    tmp_path: Path, sets: dict[str, Folder]
) -> None:
    base = vla_clones.openpi(tmp_path)
    options: dict[str, Any] = {"base": str(base), "steps": 6, "save_every": 2, "batch": 2}
    with pytest.raises(RuleError, match="ran out of memory") as caught:
        trained(tmp_path, "openpi", sets["openpi"], **options, seed=7)
    assert "smaller `batch`" in str(caught.value.hint)
    made = trained(tmp_path, "openpi", sets["openpi"], **options, seed=7)
    assert made.steps.tolist() == list(range(6))
    assert [channel.name for channel in made.contract.inputs] == ["joints", "rgb"]
    found = files(tmp_path, made)
    assert found["params/manifest.ocdbt"] == b"params of step 5"
    statistics = json.loads(found["assets/local/data/norm_stats.json"])["norm_stats"]["actions"]
    np.testing.assert_allclose(statistics["q01"], [-1, 0.495, -1])
    np.testing.assert_allclose(statistics["q99"], [1, 0.505, 1])
    np.testing.assert_allclose(statistics["std"], [1, 0.0025, 1])
    settings = json.loads(found["settings.json"])
    assert (settings["joints"], settings["camera"]) == (3, "observation.images.workspace")
    assert "base" not in settings
    assert b"def configured" in found["launch.py"]


@pytest.mark.medium
@pytest.mark.parametrize(("name", "own"), [("openvla", {"rank": 7}), ("openpi", {"seed": 8})])
def test_a_loss_that_is_no_number_ends_the_training(
    tmp_path: Path, name: str, own: dict[str, Any], sets: dict[str, Folder]
) -> None:
    base = getattr(vla_clones, name)(tmp_path)
    with pytest.raises(RuleError, match="is not a number after") as caught:
        trained(tmp_path, name, sets[name], base=str(base), steps=20, **own)
    assert caught.value.code == "DXB-B378"


@pytest.mark.medium
def test_what_is_missing_is_told(tmp_path: Path, sets: dict[str, Folder]) -> None:
    vla_clones.openvla(tmp_path)
    with pytest.raises(RuleError, match="`base` names no folder with a model") as caught:
        trained(tmp_path, "openvla", sets["openvla"], steps=2)
    assert "openvla/openvla-7b" in str(caught.value.hint)
    (tmp_path / "clone" / "vla-scripts" / "finetune.py").unlink()
    with pytest.raises(RuleError, match=r"there is no `vla-scripts/finetune\.py` beside the package `prismatic`"):
        trained(tmp_path, "openvla", sets["openvla"], steps=2)


def test_another_form_of_data_is_refused(tmp_path: Path, sets: dict[str, Folder]) -> None:
    vla_clones.openvla(tmp_path)
    with pytest.raises(RuleError, match=r"no data set of demonstrate\.rlds"):
        trained(tmp_path, "openvla", sets["openpi"])
    info = {"meta/info.json": b'{"codebase_version": "v3.0", "features": {}}'}
    vla_clones.stand_in.environment(tmp_path, "openpi", {})
    with pytest.raises(RuleError, match=r"openpi reads v2\.1"):
        trained(tmp_path, "openpi", Folder(files=info))


@pytest.mark.medium
def test_its_own_server_runs_it(tmp_path: Path, sets: dict[str, Folder]) -> None:
    base = vla_clones.openvla(tmp_path)
    made = trained(tmp_path, "openvla", sets["openvla"], base=str(base), steps=10)
    with pytest.raises(RuleError, match=r"`learn\.openvla` is run by that project's own server") as caught:
        policies.runner("openvla").predict(made, BUNDLE)
    assert "learn.served" in str(caught.value.hint)


def test_files_are_those_of_other_projects_only(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="an algorithm of dxb"):
        RuleRunner(tmp_path).run("learn.files", checkpoint=policies.checkpoint(policies.contract(BUNDLE)))
