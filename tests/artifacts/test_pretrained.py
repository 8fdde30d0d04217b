"""Pretrained models and adapters: their folders, their digests, and that they fit together."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build import digest
from dextera_build.artifacts.pretrained import Adapter, PretrainedModel
from dextera_build.artifacts.weights import Weights
from dextera_build.errors import ArtifactError
from dextera_build.models.model import ModelFile, digest_of
from tests.artifacts.test_base import Memory

RNG = np.random.default_rng(8)
MATRIX = RNG.normal(size=(5, 7)).astype(np.float32)
DOWN, UP = RNG.normal(size=(2, 7)).astype(np.float32), RNG.normal(size=(5, 2)).astype(np.float32)
REFERENCE = "hf:lab/tiny@abc123"


def folder(at: Path) -> Path:
    Weights.of({"encoder.q.weight": MATRIX, "encoder.q.bias": np.zeros(5, np.float32)}).export(at, "x")
    (at / "config.json").write_text(json.dumps({"architectures": ["TinyModel"], "sizes": [5, 7], "eps": 1e-6}))
    (at / "tokenizer").mkdir()
    (at / "tokenizer" / "vocab.txt").write_text("a b c")
    return at


@pytest.fixture
def model(tmp_path) -> PretrainedModel:
    return PretrainedModel.load(folder(tmp_path / "model"), REFERENCE)


def adapter(base: PretrainedModel, **more: object) -> Adapter:
    weights = Weights.of(
        {"base_model.model.encoder.q.lora_A.weight": DOWN, "base_model.model.encoder.q.lora_B.weight": UP}
    )
    fields = {"base": base.digest, "base_reference": REFERENCE, "weights": weights, "rank": 2, "alpha": 3.0}
    return Adapter(**fields | more)


def test_the_digest_is_that_of_installed_models(model, tmp_path):
    files = tuple(
        ModelFile(path.relative_to(tmp_path / "model").as_posix(), path.stat().st_size, digest.of_file(path))
        for path in (tmp_path / "model").rglob("*")
        if path.is_file()
    )
    assert len(files) == 3
    assert model.digest == digest_of(files)


def test_a_model_comes_back_from_its_folder(model, tmp_path):
    config, weights = model.export(tmp_path / "out", "model")
    assert json.loads(config.read_text())["sizes"] == [5, 7]
    assert np.array_equal(Weights.load(weights).array("encoder.q.weight"), MATRIX)
    memory = Memory()
    again = PretrainedModel.decode(model.encode(memory.put), memory.__getitem__)
    assert again.export(tmp_path / "again", "model")[0].read_text() == config.read_text()


def test_a_model_may_be_a_reference_alone(model, tmp_path):
    bare = model.model_copy(update={"weights": None})
    assert [path.name for path in bare.export(tmp_path / "bare", "model")] == ["config.json"]
    assert repr(bare).endswith("TinyModel, weights by reference)")
    assert repr(model).startswith(f"PretrainedModel({REFERENCE}, {model.digest[:12]}, TinyModel, 2 tensors, 40 param")


def test_a_model_without_a_configuration_is_refused(tmp_path):
    (folder(tmp_path / "a") / "config.json").write_text("[]")
    with pytest.raises(ArtifactError, match=r"`config\.json` cannot be read as JSON"):
        PretrainedModel.load(tmp_path / "a", REFERENCE)
    (tmp_path / "a" / "config.json").unlink()
    with pytest.raises(ArtifactError, match=r"`config\.json` cannot be read as JSON"):
        PretrainedModel.load(tmp_path / "a", REFERENCE)


@pytest.mark.parametrize(
    ("fields", "message"),
    [({"digest": "abc"}, "PretrainedModel.digest: String should match"), ({"reference": ""}, "at least 1 character")],
)
def test_a_reference_must_be_exact(fields, message):
    with pytest.raises(ArtifactError, match=message):
        PretrainedModel(**{"reference": "a", "digest": "0" * 64, "config": {}} | fields)


def test_an_adapter_changes_matrices(model):
    made = adapter(model)
    made.check_base(model)
    made.check_base(model.model_copy(update={"weights": None}))
    assert made.modules == ("encoder.q",)
    assert np.allclose(made.delta("encoder.q"), 1.5 * UP @ DOWN)
    assert repr(made) == f"Adapter(of {REFERENCE} ({model.digest[:12]}), rank 2, alpha 3, 1 modules, 24 parameters)"


def test_an_adapter_comes_back_from_its_folder(model, tmp_path):
    made = adapter(model)
    config, weights = made.export(tmp_path / "lora", "x")
    said = json.loads(config.read_text())
    assert (said["base_model_name_or_path"], said["r"], said["target_modules"]) == ("lab/tiny", 2, ["encoder.q"])
    again = Adapter.load(tmp_path / "lora", model)
    assert (again.base, again.rank, again.alpha) == (made.base, 2, 3.0)
    assert np.array_equal(again.delta("encoder.q"), made.delta("encoder.q"))
    assert weights.name == "adapter_model.safetensors"


def test_an_adapter_of_another_model_is_refused(model, tmp_path):
    other = model.model_copy(update={"digest": "f" * 64})
    adapter(model).export(tmp_path / "lora", "x")
    with pytest.raises(ArtifactError, match="the adapter belongs to another model") as caught:
        Adapter.load(tmp_path / "lora", other)
    assert caught.value.code == "DXB-A416"
    names = {"adapter": f"{REFERENCE} {model.digest[:12]}", "model": f"{REFERENCE} ffffffffffff"}
    assert caught.value.facts == names
    thin = model.model_copy(update={"weights": Weights.of({"encoder.q.weight": MATRIX[:, :3].copy()})})
    with pytest.raises(ArtifactError, match=r"changes `encoder\.q\.weight` \(5, 7\), which the model does not have"):
        adapter(thin).check_base(thin)
    none = model.model_copy(update={"weights": Weights.of({"k.weight": MATRIX})})
    with pytest.raises(ArtifactError, match="which the model does not have"):
        adapter(none).check_base(none)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"q.lora_A.weight": DOWN}, "are not pairs of `lora_A.weight` and `lora_B.weight`"),
        ({"q.lora_A.weight": DOWN, "q.lora_B.weight": UP, "q.bias": UP}, "are not pairs of"),
        ({"q.lora_A.weight": UP, "q.lora_B.weight": DOWN}, "but the rank is 2"),
        ({"q.lora_A.weight": DOWN[0].copy(), "q.lora_B.weight": UP}, "but the rank is 2"),
    ],
)
def test_other_changes_are_no_adapters(model, arrays, message):
    with pytest.raises(ArtifactError) as caught:
        adapter(model, weights=Weights.of(arrays))
    assert caught.value.code == "DXB-A415"
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"peft_type": "IA3"}, "it is IA3 with biases, not plain LoRA"),
        ({"use_dora": True}, "it is LORA with use_dora, not plain LoRA"),
        ({"bias": "all"}, "it is LORA with biases, not plain LoRA"),
        ({"r": "many"}, "no number"),
        ({"lora_alpha": None}, "no number"),
    ],
)
def test_other_kinds_of_adapters_are_refused(model, tmp_path, change, why):
    config = adapter(model).export(tmp_path, "x")[0]
    config.write_text(json.dumps(json.loads(config.read_text()) | change))
    with pytest.raises(ArtifactError, match=r"`adapter_config\.json` cannot be read as a LoRA adapter") as caught:
        Adapter.load(tmp_path, model)
    assert why in caught.value.facts["why"]
