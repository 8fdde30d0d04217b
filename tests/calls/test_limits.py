"""Rates and slots of a service hold over threads and processes, and nobody waits for the dead."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter

import pytest

from dextera_build.calls import limits
from dextera_build.calls.limits import Limits, locked_json

HOLD = """
import sys, time
from pathlib import Path
from dextera_build.calls.limits import Limits
with Limits(Path(sys.argv[1]), "forge", None, 1, print).slot():
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def clock(monkeypatch):
    """A clock that only `sleep` moves."""
    now = [1e9]
    monkeypatch.setattr(limits.time, "time", lambda: now[0])
    monkeypatch.setattr(limits.time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    return now


def forge(folder, per_minute=None, concurrent=None, log=lambda text: None):
    return Limits(folder, "forge", per_minute, concurrent, log)


def test_no_minute_has_more_requests_than_the_rate(tmp_path, clock):
    times = []
    for _ in range(25):
        forge(tmp_path, 7).wait_for_turn()  # another process each time
        times.append(clock[0])
        clock[0] += 3.0
    assert all(later - earlier >= 60.0 - 1e-6 for earlier, later in zip(times, times[7:], strict=False))
    assert times[24] - times[0] < 60.0 * 4  # and none waits longer than it must


def test_a_long_wait_is_told_once(tmp_path, clock):
    told = []
    for _ in range(2):
        forge(tmp_path, 1, log=told.append).wait_for_turn()
    assert told == ["forge: waits 60 s for its turn"]


def test_services_do_not_share_limits(tmp_path, clock):
    forge(tmp_path, 1).wait_for_turn()
    Limits(tmp_path, "chat", 1, None, print).wait_for_turn()
    assert clock[0] == 1e9


def test_a_clock_that_was_set_back_stops_nobody(tmp_path, clock):
    forge(tmp_path, 1).wait_for_turn()
    forge(tmp_path, 1).rest(30.0)
    clock[0] -= 1e6
    forge(tmp_path, 1).wait_for_turn()
    assert clock[0] == 1e9 - 1e6


def test_all_processes_rest_when_one_is_told_to(tmp_path, clock):
    told, other = forge(tmp_path), forge(tmp_path)
    told.rest(20.0)
    told.wait_for_turn()  # it was told itself, and rests itself
    assert clock[0] == 1e9
    other.wait_for_turn()
    assert clock[0] == pytest.approx(1e9 + 20.0)


def test_without_limits_nothing_is_written(tmp_path):
    plain = forge(tmp_path / "services")
    plain.wait_for_turn()
    with plain.slot():
        pass
    assert not (tmp_path / "services").exists()


def test_threads_share_slots(tmp_path):
    at_once, most, lock = Counter(), [], threading.Lock()

    def use():
        with forge(tmp_path, concurrent=2).slot():
            with lock:
                at_once["now"] += 1
                most.append(at_once["now"])
            time.sleep(0.05)
            with lock:
                at_once["now"] -= 1

    threads = [threading.Thread(target=use) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 2
    assert len(most) == 6


def test_a_slot_of_a_killed_process_is_free(tmp_path):
    other = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "held\n"
    got = threading.Event()

    def use():
        with forge(tmp_path, concurrent=1).slot():
            got.set()

    thread = threading.Thread(target=use)
    thread.start()
    assert not got.wait(0.3)
    other.kill()
    other.wait()
    assert got.wait(10)
    thread.join()


def test_a_damaged_state_is_an_empty_one(tmp_path):
    path = tmp_path / "state.json"
    for text in (b"[1, 2", b"[]", b"\xff", b'{"n": 1} of a longer text'):
        path.write_bytes(text)
        with locked_json(path) as state:
            assert state in ({}, {"n": 1})
            state["n"] = 2
        assert path.read_bytes() == b'{"n": 2}'
