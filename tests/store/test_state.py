"""The file of local state: damage, several writers, and places where it cannot be written."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import time
from pathlib import Path

import pytest

from dextera_build.store.state import State

ROWS = {f"node{number}\udcff": b"value %d " % number * 20 for number in range(600)}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "local" / "state.db"


def test_rows_come_back_by_kind_and_name(path: Path) -> None:
    state = State(str(path))
    assert (state.all("a"), state.get("a", "x"), state.kinds()) == ({}, None, [])
    assert not path.exists()
    assert state.put("a", ROWS)
    assert state.put("b\0c", {"x": b""})
    again = State(str(path))
    assert again.all("a") == ROWS
    assert again.some("a", [*ROWS, "none"]) == ROWS
    assert again.get("b\0c", "x") == b""
    assert sorted(again.kinds()) == ["a", "b\0c"]
    first, *rest = ROWS
    assert state.put("a", {first: b"new"}, without=rest)
    assert again.all("a") == {first: b"new"}


@pytest.mark.medium
def test_damage_anywhere_loses_rows_and_changes_none(path: Path) -> None:
    State(str(path)).put("a", ROWS)
    whole, dice = path.read_bytes(), random.Random(1)
    for place in (*range(0, 200, 7), *(dice.randrange(len(whole)) for _ in range(150))):
        for damaged in (whole[:place], whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :]):
            path.write_bytes(damaged)
            state = State(str(path))
            assert state.all("a").items() <= ROWS.items()
            assert state.some("a", list(ROWS)[::50]).items() <= ROWS.items()
            state.kinds()
            assert state.put("a", {"after": b"damage"})
            assert state.get("a", "after") == b"damage"


def test_a_schema_that_is_no_text_is_damage(path: Path) -> None:
    assert State(str(path)).put("a", {"one": b"1"})
    data = path.read_bytes()
    assert data.count(b"CREATE TABLE") == 1
    path.write_bytes(data.replace(b"CREATE TABLE", b"CREATE \x80ABLE"))  # SQLite's message quotes it
    assert State(str(path)).all("a") == {}
    assert State(str(path)).put("a", {"two": b"2"})
    assert State(str(path)).all("a") == {"two": b"2"}


def test_a_folder_in_its_place_is_set_aside(path: Path) -> None:
    (path / "inner").mkdir(parents=True)
    state = State(str(path))
    assert state.all("a") == {}
    assert state.put("a", {"x": b"y"})
    assert state.all("a") == {"x": b"y"}


def write(path: str, number: int) -> None:
    for count in range(25):
        assert State(path).put("a", {f"{number} {count}": b"%d" % count, "all": b"%d" % number})


def test_several_writers_lose_nothing(path: Path) -> None:
    writers = [multiprocessing.get_context("spawn").Process(target=write, args=(str(path), n)) for n in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0] * 4
    found = State(str(path)).all("a")
    assert found.keys() == {"all", *(f"{number} {count}" for number in range(4) for count in range(25))}


def write_on(path: str) -> None:
    number = 0
    while True:
        State(path).put("a", dict.fromkeys(ROWS, b"%d" % number))
        number += 1


@pytest.mark.medium
def test_a_killed_writer_leaves_all_or_nothing(path: Path) -> None:
    State(str(path)).put("a", dict.fromkeys(ROWS, b"-"))
    dice = random.Random(2)
    for _ in range(4):
        writer = multiprocessing.get_context("fork").Process(target=write_on, args=(str(path),))
        writer.start()
        time.sleep(0.05 + dice.random() / 10)
        os.kill(writer.pid or 0, signal.SIGKILL)
        writer.join()
        found = State(str(path)).all("a")
        assert found.keys() == ROWS.keys()
        assert len(set(found.values())) == 1


def test_a_store_that_may_only_be_read_is_read(path: Path) -> None:
    State(str(path)).put("a", ROWS)
    path.chmod(0o444)
    path.parent.chmod(0o555)
    before = sorted(os.listdir(path.parent))
    state = State(str(path), takes=False)
    assert state.all("a") == ROWS
    assert not state.put("a", {"x": b"y"})
    assert sorted(os.listdir(path.parent)) == before
    path.parent.chmod(0o755)
