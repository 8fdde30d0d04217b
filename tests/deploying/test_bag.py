"""Recordings of runs: none replaces another, and a run that was refused leaves none."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.cli.robot import connected
from dextera_build.deploying import periods
from dextera_build.deploying.bag import Bag
from dextera_build.deploying.loopback import Bus, Loopback
from dextera_build.errors import DxbError, MachineError, UsageError
from tests import task_bundles

ARGS = argparse.Namespace(robot="127.0.0.1", out=None)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    """A bus instead of a network."""
    bus = Bus()
    monkeypatch.setattr(connected, "transport", lambda args, peers: Loopback(bus))
    return bus


def refused(out: Path, error: BaseException) -> None:
    with pytest.raises(type(error)), connected.recorded(ARGS, out):
        raise error


def test_a_recording_that_exists_is_kept(tmp_path: Path, bus: Bus) -> None:
    out = tmp_path / "1.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(UsageError, match=r"1\.mcap` exists") as caught, connected.recorded(ARGS, out):
        pass
    assert (caught.value.code, out.read_bytes(), bus.members) == ("DXB-U330", b"precious", [])
    here: Any = argparse.Namespace(bundle=task_bundles.lift())
    with pytest.raises(UsageError, match=r"1\.mcap` exists"):  # before a tracker is started
        connected.recording(argparse.Namespace(out=str(out)), here, "runs")


@pytest.mark.parametrize("error", [MachineError("it is not ready", code="DXB-E442"), KeyboardInterrupt()])
def test_a_run_that_does_not_begin_leaves_no_recording(tmp_path: Path, bus: Bus, error: BaseException) -> None:
    refused(tmp_path / "runs" / "1.mcap", error)
    assert list((tmp_path / "runs").iterdir()) == bus.members == []


def test_what_was_recorded_before_a_failure_is_kept(tmp_path: Path, bus: Bus) -> None:
    out, bundle = tmp_path / "1.mcap", task_bundles.lift()

    def run(bag: Bag) -> None:
        periods.commanded(bag, 1, bundle, 1, {"/sent": np.zeros(5)})
        raise MachineError("the disk is gone", code="DXB-E442")

    with pytest.raises(MachineError), connected.recorded(ARGS, out) as (_, bag):
        run(bag)
    assert out.stat().st_size > 100
    assert bus.members == []


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path: Path, bus: Bus) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(DxbError) as caught, connected.recorded(ARGS, tmp_path / "file" / "1.mcap"):
        pass
    assert (caught.value.code, bus.members) == ("DXB-U349", [])


def test_a_network_that_cannot_be_used_leaves_no_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(args: object, peers: object) -> None:
        raise MachineError("no participant can be made", code="DXB-E441")

    monkeypatch.setattr(connected, "transport", fails)
    with pytest.raises(MachineError), connected.recorded(ARGS, tmp_path / "1.mcap"):
        pass
    assert list(tmp_path.iterdir()) == []
