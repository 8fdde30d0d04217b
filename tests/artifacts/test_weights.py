"""Weights in safetensors: shards and their index, as other programs write and read them; what is refused."""

from __future__ import annotations

import json
import pickle
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from dextera_build.artifacts.weights import INDEX, Tensor, Weights
from dextera_build.errors import ArtifactError
from tests.artifacts.generated import values
from tests.artifacts.test_base import Memory

RNG = np.random.default_rng(7)
ARRAYS = {
    "layer.0.weight": RNG.normal(size=(4, 6)).astype(np.float32),
    "layer.0.bias": RNG.normal(size=4).astype(np.float16),
    "steps": np.array(12, np.int64),
    "mask": np.array([True, False]),
}


def same(weights: Weights) -> bool:
    return all(np.array_equal(weights.array(name), array) for name, array in ARRAYS.items())


@given(values(Weights))
@settings(deadline=None, max_examples=40)
def test_files_give_back_what_was_saved(tmp_path_factory, made):
    folder = tmp_path_factory.mktemp("weights")
    whole = Weights.load(made.save(folder / "one" / "whole.safetensors")[0])
    parts = Weights.load(made.save(folder / "many" / "model.safetensors.index.json")[0])
    exported = Weights.load(made.export(folder / "exported", "stem")[0])
    assert parts.encode(Memory().put) == made.encode(Memory().put) == exported.encode(Memory().put)
    assert list(whole.shards) == ["whole.safetensors"]
    for name, tensor in made.tensors.items():
        again = whole.tensors[name]
        assert (again.dtype, again.shape) == (tensor.dtype, tensor.shape)
        assert np.array_equal(whole.array(name), made.array(name))


def test_equal_arrays_are_equal_weights():
    again = dict(reversed(ARRAYS.items()))
    assert Weights.of(ARRAYS).encode(Memory().put) == Weights.of(again).encode(Memory().put)


def test_the_library_of_the_format_reads_it(tmp_path):
    library = pytest.importorskip("safetensors.numpy")
    read = library.load_file(Weights.of(ARRAYS).save(tmp_path / "a.safetensors")[0])
    assert {name: array.dtype for name, array in read.items()} == {name: array.dtype for name, array in ARRAYS.items()}
    assert all(np.array_equal(read[name], array) for name, array in ARRAYS.items())


def test_what_the_library_of_the_format_writes_is_read(tmp_path):
    library = pytest.importorskip("safetensors.numpy")
    library.save_file(ARRAYS, tmp_path / "a.safetensors", {"format": "np"})
    read = Weights.load(tmp_path / "a.safetensors")
    assert same(read)
    assert read.notes == {"format": "np"}


def test_numbers_of_brains_are_read_exactly(tmp_path):
    torch = pytest.importorskip("torch")
    from safetensors.torch import save_file

    values = torch.tensor([1.5, -0.15625, 3e38, 0.0]).to(torch.bfloat16)
    save_file({"a": values, "b": values.to(torch.float8_e4m3fn)}, tmp_path / "a.safetensors")
    read = Weights.load(tmp_path / "a.safetensors")
    assert read.array("a").tolist() == values.float().tolist()
    with pytest.raises(ArtifactError, match="cannot be read as safetensors") as caught:
        read.array("b")
    assert "NumPy has no numbers of type F8_E4M3" in caught.value.facts["why"]


def test_shards_are_named_and_indexed_as_hugging_face_does(tmp_path):
    made = Weights.of(ARRAYS, shard_bytes=105)
    assert list(made.shards) == ["model-00001-of-00002.safetensors", "model-00002-of-00002.safetensors"]
    index, *shards = made.export(tmp_path, "weights")
    assert index.name == "model.safetensors.index.json"
    said = json.loads(index.read_text())
    assert said["metadata"]["total_size"] == sum(array.nbytes for array in ARRAYS.values())
    assert set(said["weight_map"]) == set(ARRAYS)
    assert [shard.name for shard in shards] == list(made.shards)
    assert same(Weights.load(tmp_path))
    assert same(Weights.load(Weights.load(tmp_path).save(tmp_path / "one" / "all.safetensors")[0]))


def test_one_file_needs_no_index(tmp_path):
    assert [path.name for path in Weights.of(ARRAYS).export(tmp_path, "x")] == ["model.safetensors"]
    assert same(Weights.load(tmp_path))


def test_its_line():
    assert repr(Weights.of(ARRAYS, shard_bytes=105)) == (
        "Weights(4 tensors, 31 parameters, BOOL, F16, F32, I64, 2 files, 114 bytes)"
    )


def test_notes_can_be_changed():
    made = Weights.of(ARRAYS, {"a": "b"}, shard_bytes=105).noted({"c": "d"})
    assert (made.notes, list(made.shards)) == ({"c": "d"}, ["model.safetensors"])
    assert same(made)


def test_a_tensor_that_is_not_there_is_named():
    with pytest.raises(ArtifactError, match=r"the weights have no tensor `layer\.0\.wight`") as caught:
        Weights.of(ARRAYS).array("layer.0.wight")
    assert caught.value.code == "DXB-A412"
    assert caught.value.hint == "did you mean `layer.0.weight`?"


def test_numbers_without_a_type_are_refused():
    with pytest.raises(ArtifactError, match="safetensors has no numbers of type complex128") as caught:
        Weights.of({"a": np.zeros(2, complex)})
    assert caught.value.code == "DXB-A413"


@pytest.mark.parametrize(
    ("shards", "shard", "message"),
    [
        (["a/b.safetensors"], "a/b.safetensors", "'a/b.safetensors' is no name of a safetensors file"),
        (["a.bin"], "a.bin", "'a.bin' is no name of a safetensors file"),
        (["a.safetensors"], "b.safetensors", "the tensors are in b.safetensors, but the shards are a.safetensors"),
        (["a.safetensors", "c.safetensors"], "a.safetensors", "but the shards are a.safetensors, c.safetensors"),
    ],
)
def test_names_must_fit(shards, shard, message):
    one = Weights.of({"x": np.zeros(1)})
    file = next(iter(one.shards.values()))
    with pytest.raises(ArtifactError) as caught:
        Weights(shards=dict.fromkeys(shards, file), tensors={"x": Tensor(dtype="F64", shape=(1,), shard=shard)})
    assert caught.value.code == "DXB-A411"
    assert message in caught.value.message


def test_weights_are_not_empty():
    with pytest.raises(ArtifactError, match=r"Weights\.tensors: Dictionary should have at least 1 item"):
        Weights.of({})


def index_of(**tensors: object) -> bytes:
    text = json.dumps(tensors).encode()
    return struct.pack("<Q", len(text)) + text


GOOD = {"dtype": "U8", "shape": [2], "data_offsets": [0, 2]}


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "does not begin with an index of tensors"),
        (pickle.dumps({"a": 1}) + bytes(50), "does not begin with an index of tensors"),
        (struct.pack("<Q", 1 << 60) + b"{}", "does not begin with an index of tensors"),
        (struct.pack("<Q", 4) + b"{{{{", "its index of tensors is damaged"),
        (struct.pack("<Q", 2) + b"[]", "its index of tensors is damaged"),
        (index_of(a=GOOD | {"dtype": "F7"}) + b"12", "numbers of the unknown type F7"),
        (index_of(a=GOOD | {"shape": [-2]}) + b"12", "a size is no whole number"),
        (index_of(a=GOOD | {"shape": [3]}) + b"12", "the bytes of tensor `a` are not where its index says"),
        (index_of(a=GOOD, b=GOOD) + b"12", "the bytes of tensor `b` are not where its index says"),
        (index_of(a=GOOD) + b"1", "but its index says"),
        (index_of(a=GOOD) + b"123", "but its index says"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, data, why):
    (tmp_path / "a.safetensors").write_bytes(data)
    with pytest.raises(ArtifactError, match=r"`a\.safetensors` cannot be read as safetensors") as caught:
        Weights.load(tmp_path / "a.safetensors")
    assert caught.value.code == "DXB-A402"
    assert why in caught.value.facts["why"]


def test_a_file_that_changed_is_noticed(tmp_path):
    path = Weights.of(ARRAYS).save(tmp_path / "a.safetensors")[0]
    read = Weights.load(path)
    Weights.of({"steps": np.zeros(3, np.float32)}).save(path)
    with pytest.raises(ArtifactError, match="cannot be read as safetensors") as caught:
        read.array("steps")
    assert "tensor `steps` is not as the weights say" in caught.value.facts["why"]


@pytest.mark.parametrize("name", ["pytorch_model.bin", "model.pt", "last.ckpt"])
def test_a_pickle_is_never_read(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    for path in (tmp_path / name, tmp_path):
        with pytest.raises(ArtifactError, match=f"`{name}` may hold a pickle, which runs code") as caught:
            Weights.load(path)
        assert caught.value.code == "DXB-A414"
        assert ".safetensors" in (caught.value.hint or "")


def sharded(folder: Path) -> Path:
    return Weights.of(ARRAYS, shard_bytes=105).export(folder, "x")[0]


def edited(folder: Path, **weight_map: str) -> Path:
    index = sharded(folder)
    said = json.loads(index.read_text())
    said["weight_map"] |= weight_map
    index.write_text(json.dumps(said))
    return index


def test_an_index_that_does_not_fit_its_files_is_refused(tmp_path):
    with pytest.raises(ArtifactError, match="an index of safetensors") as caught:
        Weights.load(edited(tmp_path / "a", more="model-00001-of-00002.safetensors"))
    assert "tensor `more` is in none of its files" in caught.value.facts["why"]
    with pytest.raises(ArtifactError, match="an index of safetensors") as caught:
        Weights.load(edited(tmp_path / "b", steps="model-00001-of-00002.safetensors"))
    assert "tensor `steps` is in model-00002-of-00002.safetensors" in caught.value.facts["why"]
    with pytest.raises(ArtifactError, match="an index of safetensors") as caught:
        Weights.load(edited(tmp_path / "c", steps="../secret.safetensors"))
    assert "a file of it is not beside it" in caught.value.facts["why"]
    (tmp_path / f"d{INDEX}").write_text("{}")
    with pytest.raises(ArtifactError, match="an index of safetensors"):
        Weights.load(tmp_path / f"d{INDEX}")


def test_files_that_are_missing_or_double_are_named(tmp_path):
    index = sharded(tmp_path)
    (tmp_path / "model-00002-of-00002.safetensors").unlink()
    with pytest.raises(ArtifactError, match=r"`model-00002-of-00002\.safetensors` cannot be read"):
        Weights.load(index)
    (tmp_path / "model-00002-of-00002.safetensors").write_bytes(
        (tmp_path / "model-00001-of-00002.safetensors").read_bytes()
    )
    with pytest.raises(ArtifactError, match="cannot be read as safetensors") as caught:
        Weights.load(index)
    assert "another file has tensor" in caught.value.facts["why"]
    index.unlink()
    with pytest.raises(ArtifactError, match="cannot be read as safetensors") as caught:
        Weights.load(tmp_path)
    assert "it holds model-00001-of-00002.safetensors, model-00002" in caught.value.facts["why"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ArtifactError, match="cannot be read as safetensors") as caught:
        Weights.load(tmp_path / "empty")
    assert caught.value.facts["why"] == "it holds no `.safetensors` file"
