"""Weights, loaded models and memory of a backend."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.rule import Context, pretrained
from dextera_build.rule.pretrained import Pretrained, out_of_memory, unload

CALLS: list[tuple[object, ...]] = []


class Model:
    """A loaded model."""


def load(*given: object) -> Model:
    CALLS.append(given)
    return Model()


def load_other(*given: object) -> Model:
    return load("other", *given)


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    CALLS.clear()
    yield
    unload()


def context(tmp_path: Path, *weights: str, device: pretrained.Device = "cpu") -> Context:
    return Context(scratch=tmp_path, pretrained=Pretrained(weights, Path, device))


def test_a_model_is_loaded_once_for_its_weights_and_device(tmp_path: Path) -> None:
    one = context(tmp_path, "a@1", "b@2")
    assert (one.weights("b"), one.device) == (Path("b@2"), "cpu")
    model = one.load(load, "a")
    assert context(tmp_path, "a@1").load(load, "a") is model
    assert one.load(load, "a", "b") is not model
    assert context(tmp_path, "a@1", device="cuda").load(load, "a") is not model
    assert context(tmp_path, "a@9").load(load, "a") is not model
    assert one.load(load_other, "a") is not model
    assert CALLS[:2] == [(Path("a@1"), "cpu"), (Path("a@1"), Path("b@2"), "cpu")]
    assert len(CALLS) == 5


def test_models_of_other_weights_are_freed(tmp_path: Path) -> None:
    ctx = context(tmp_path, "a@1", "b@2")
    kept, gone = (weakref.ref(ctx.load(load, name)) for name in "ab")
    unload(but=("a@1", "c@3"))
    gc.collect()
    assert kept() is not None
    assert gone() is None


def test_a_function_that_cannot_be_named_again_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="a function of a module"):
        context(tmp_path, "a@1").load(lambda folder, device: Model(), "a")


def test_weights_that_are_not_declared_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="does not declare the weights `ab`") as caught:
        context(tmp_path, "abc@1").weights("ab")
    assert caught.value.hint == "did you mean `abc`?"
    with pytest.raises(RuleError) as caught:
        Context(scratch=tmp_path).weights("a")
    assert caught.value.hint == '`BACKEND = Backend(..., weights=("a",))`'


def test_each_librarys_way_to_say_that_memory_ran_out_is_known() -> None:
    import torch

    for call in (lambda: np.empty(1 << 55), lambda: torch.empty(1 << 50), lambda: bytearray(1 << 62)):
        with pytest.raises((MemoryError, RuntimeError)) as caught:
            call()
        told = out_of_memory(caught.value, "cpu")
        assert told is not None
        assert (told.code, told.message) == ("DXB-E389", "the machine's memory is used up")
        assert "--jobs 1" in str(told.hint)
    told = out_of_memory(torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"), "cuda")
    assert told is not None
    assert told.message == "the GPU has too little memory for the backend"
    assert told.facts == {"device": "cuda", "it says": "CUDA out of memory. Tried to allocate 2 GiB"}
    assert out_of_memory(RuntimeError("anything else"), "cpu") is None
