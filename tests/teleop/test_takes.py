"""The recording of a session: whole takes, whatever happens to the disk."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream, Workplace
from dextera_build.errors import StoreError
from dextera_build.sim.experts.live_operator import TICKS_HZ, Message
from dextera_build.store import files
from dextera_build.teleop import posture, protocol
from dextera_build.teleop.takes import Kept, Takes
from tests.teleop import pages


def taken(seed: int, ticks: tuple[int, ...] = (0, 7, 26)) -> Kept:
    """A take of a few messages, whose left hand drives nothing."""
    frames = [pages.joints(pages.opened() + 1e-3 * tick, tick) for tick in ticks]
    rows = [(tick, protocol.frame(data, 0.0, 0.3).message) for tick, data in zip(ticks, frames, strict=True)]
    return Kept(seed, rows, posture.lengths() * [[1.0], [1.1]], [1])


@pytest.fixture
def takes(tmp_path: Path) -> Takes:
    return Takes(tmp_path / "made.mcap", synthetic=True)


def test_a_recording_holds_messages_times_seeds_and_lengths_exactly(takes: Takes):
    made = [taken(7), taken(8, (0, 100))]
    for each in made:
        takes.add(each)
    found = HandStream.load(takes.path)
    assert takes.unsaved == ""
    assert [(take.first, take.last, take.seed) for take in found.takes] == [(0, 3, 7), (3, 5, 8)]
    assert found.takes[0].finger_lengths_m == tuple(map(tuple, (posture.lengths() * [[1.0], [1.1]]).tolist()))
    messages: list[Message] = [message for each in made for _, message in each.rows]
    assert found.positions.tobytes() == np.array([each.positions for each in messages]).tobytes()
    assert found.rotations.tobytes() == np.array([each.rotations for each in messages]).tobytes()
    assert (found.frame, found.synthetic) == ("base", True)
    assert found.clutch.tolist() == [[False, True]] * 5
    # Differences of times are exact wherever a take begins.
    for take, each in zip(found.takes, made, strict=True):
        own = found.stamps[take.first : take.last]
        assert ((own - own[0]) * TICKS_HZ).tolist() == [tick for tick, _ in each.rows]


def test_a_recording_says_which_task_and_robot_it_was_made_with(tmp_path: Path):
    place = Workplace(task="LiftCan", robot="kuka_leap", joints=("a", "b"), model="0f")
    takes = Takes(tmp_path / "made.mcap", synthetic=True, workplace=place)
    takes.add(taken(1))
    assert HandStream.load(takes.path).workplace == place


def test_undo_drops_the_last_take_and_the_file_with_the_first(takes: Takes):
    takes.add(taken(1))
    takes.add(taken(2))
    dropped = takes.undo()
    assert dropped is not None
    assert dropped.seed == 2
    assert [take.seed for take in HandStream.load(takes.path).takes] == [1]
    takes.undo()
    assert not takes.path.exists()
    assert takes.undo() is None


def test_a_full_disk_loses_no_take(takes: Takes, monkeypatch: pytest.MonkeyPatch):
    takes.add(taken(1))
    before = takes.path.read_bytes()

    def full(*words: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        takes.add(taken(2))
    assert "No space left" in takes.unsaved
    assert takes.path.read_bytes() == before
    assert sorted(path.name for path in takes.path.parent.iterdir()) == ["made.mcap"]
    takes.save()
    assert takes.unsaved == ""
    assert [take.seed for take in HandStream.load(takes.path).takes] == [1, 2]


def test_a_kill_while_writing_leaves_the_takes_before(takes: Takes, monkeypatch: pytest.MonkeyPatch):
    takes.add(taken(1))

    def killed(*words: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "write_all", killed)
    with pytest.raises(KeyboardInterrupt):
        takes.add(taken(2))
    assert [take.seed for take in HandStream.load(takes.path).takes] == [1]


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path):
    (tmp_path / "gone").write_text("a file where the folder was")
    takes = Takes(tmp_path / "gone" / "made.mcap", synthetic=True)
    takes.add(taken(1))
    assert takes.unsaved
    assert len(takes.kept) == 1
    with pytest.raises(StoreError):
        files.write(str(takes.path), b"")


def test_hands_without_a_head_make_a_recording_without_one(takes: Takes):
    kept = taken(1)
    rows = [
        (tick, Message(**(vars(message) | {"head": np.full(7, np.nan, np.float32)}))) for tick, message in kept.rows
    ]
    takes.add(kept._replace(rows=rows))
    assert HandStream.load(takes.path).head is None
