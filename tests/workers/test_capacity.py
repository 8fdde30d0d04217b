"""What a machine has: measured, said, and refused where it makes no sense."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.errors import UsageError
from dextera_build.workers.capacity import Capacity, Gpu, available_gb, measure, parse


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with two devices, as its driver's tool says."""
    tool = tmp_path / "nvidia-smi"
    tool.write_text("#!/bin/sh\necho 'GPU-aa, 24576'\necho 'GPU-bb, 8192'\n")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)


@pytest.mark.usefixtures("devices")
def test_devices_are_those_that_the_driver_names() -> None:
    assert measure(2).gpus == (Gpu("GPU-aa", 24.0), Gpu("GPU-bb", 8.0))
    assert measure(2, gpus=False).gpus == ()


@pytest.mark.usefixtures("devices")
@pytest.mark.parametrize(
    ("told", "names"), [("1", ["GPU-bb"]), ("GPU-bb,0", ["GPU-bb", "GPU-aa"]), ("", []), ("7", [])]
)
def test_devices_that_are_hidden_are_not_there(monkeypatch: pytest.MonkeyPatch, told: str, names: list[str]) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", told)
    assert [gpu.id for gpu in measure(2).gpus] == names


@pytest.mark.usefixtures("devices")
def test_what_is_said_counts() -> None:
    said = parse("gpu=1,gpu_memory=10,memory=3,cpu=7,licence:x=2")
    assert measure(2, said) == Capacity(7, 3.0, (Gpu("GPU-aa", 10.0),), {"licence:x": 2.0})
    assert measure(2, parse("gpu=0")).gpus == ()
    assert [gpu.id for gpu in measure(2, parse("gpu=3")).gpus] == ["GPU-aa", "GPU-bb", "2"]


def test_a_machine_without_a_driver_has_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    found = measure(3)
    assert (found.cpus, found.gpus, dict(found.named)) == (3, (), {})
    assert 0.25 <= found.memory_gb == pytest.approx(available_gb(), rel=0.5)


def test_a_limit_of_the_control_group_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dextera_build.workers.capacity._limit_gb", lambda: 0.5)
    assert available_gb() == 0.5
    monkeypatch.setattr("dextera_build.workers.capacity._limit_gb", lambda: -3.0)
    assert available_gb() == 0.25


def test_tables_and_texts_say_the_same() -> None:
    assert parse({"gpu": 1, "licence:x": 2}) == parse(" gpu=1, licence:x=2 ") == {"gpu": 1.0, "licence:x": 2.0}
    assert parse("") == {}


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        ("memroy=4", "DXB-U170", "`memroy` is not a resource"),
        ({"gpu": True}, "DXB-U171", "resource `gpu` is a number from zero up, not `True`"),
        ({"gpu": "nan"}, "DXB-U171", "resource `gpu` is a number from zero up, not `nan`"),
        (["gpu"], "DXB-U172", "`['gpu']` is not of the form `NAME=AMOUNT,...`"),
        ("=3", "DXB-U172", "`=3` is not of the form `NAME=AMOUNT,...`"),
    ],
)
def test_nonsense_is_refused(given: object, code: str, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse(given, "dxb.toml")
    assert (caught.value.code, caught.value.message, caught.value.facts["from"]) == (code, said, "dxb.toml")
    assert caught.value.hint == ("did you mean `memory`?" if code == "DXB-U170" else caught.value.hint)
