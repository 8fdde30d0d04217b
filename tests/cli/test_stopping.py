"""Keys of the terminal and of an input device stop a run; a device that goes away does, too."""

from __future__ import annotations

import argparse
import os
import pty
import signal
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from dextera_build.cli.robot import connected, stopping
from dextera_build.deploying.bag import Bag
from dextera_build.errors import MachineError


def event(kind: int, code: int, value: int) -> bytes:
    """What the kernel writes for one event of an input device."""
    return stopping.EVENT.pack(1, 2, kind, code, value)


@pytest.fixture
def pedal(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pedal")
    return tmp_path / "pedal"


def test_an_event_has_the_length_of_the_kernels_structure() -> None:
    assert stopping.EVENT.size == 24


@pytest.mark.parametrize(
    ("events", "stops"),
    [
        (event(4, 4, 458756) + event(1, 30, 1) + event(0, 0, 0), True),  # scan code, key `a` down, end of report
        (event(1, 30, 0) + event(0, 0, 0), False),  # released
        (event(2, 0, 1), False),  # a mouse moves
    ],
)
def test_a_key_of_a_device_stops(pedal: Path, events: bytes, stops: bool) -> None:
    writer = os.open(pedal, os.O_RDWR)
    with stopping.stops(str(pedal)) as halt:
        os.write(writer, events)
        assert halt.wait(5.0 if stops else 0.2) == stops
    os.close(writer)


@pytest.mark.parametrize("size", [3, 8])
def test_reports_of_another_form_stop(pedal: Path, size: int) -> None:
    writer = os.open(pedal, os.O_RDWR)
    with stopping.stops(str(pedal)) as halt:
        os.write(writer, bytes(size))
        assert halt.wait(5.0)
    os.close(writer)


def test_whatever_ends_the_reading_stops(pedal: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(data: bytes) -> bool:
        raise ZeroDivisionError

    monkeypatch.setattr(stopping, "key_pressed", broken)
    monkeypatch.setattr(threading, "excepthook", lambda about: None)
    writer = os.open(pedal, os.O_RDWR)
    with stopping.stops(str(pedal)) as halt:
        os.write(writer, event(2, 0, 1))
        assert halt.wait(5.0)
    os.close(writer)


def test_a_device_without_events_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pedal").symlink_to("/dev/null")
    with (
        pytest.raises(MachineError, match=r"pedal` is no input device whose keys can be read"),
        stopping.stops(str(tmp_path / "pedal")),
    ):
        pass


def test_a_device_that_is_unplugged_stops(pedal: Path) -> None:
    writer = os.open(pedal, os.O_RDWR)
    with stopping.stops(str(pedal)) as halt:
        only = os.open(pedal, os.O_WRONLY)
        os.close(writer)
        assert not halt.wait(0.2)
        os.close(only)
        assert halt.wait(5.0)


def test_a_device_that_is_not_there_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(MachineError, match=r"cannot be read: No such file or directory"),
        stopping.stops(str(tmp_path / "none")),
    ):
        pass


def test_any_key_of_the_terminal_stops_and_the_terminal_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    import termios

    master, slave = pty.openpty()
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        before = termios.tcgetattr(slave)
        with stopping.stops(None) as halt:
            assert not halt.wait(0.1)
            os.write(master, b" xy")
            assert halt.wait(5.0)
        assert termios.tcgetattr(slave) == before
        os.write(master, b"n\n")
        time.sleep(0.1)
        assert terminal.readline() == "n\n"  # the rest of the keys is no answer
    os.close(master)


def test_a_signal_stops_and_a_second_one_interrupts() -> None:
    halt, before = threading.Event(), signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in background
    try:
        with stopping.signals(halt):
            signal.raise_signal(signal.SIGINT)
            assert halt.is_set()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_terminal_that_ends_stops_and_leaves_time_to_close_the_recording() -> None:
    halt, before = threading.Event(), signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with stopping.signals(halt):
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGHUP)
        assert halt.is_set()
        signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_run_that_outlives_its_terminal_by_intention_goes_on() -> None:
    halt, before = threading.Event(), signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as `nohup` does
    try:
        with stopping.signals(halt):
            signal.raise_signal(signal.SIGHUP)
        assert not halt.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_question_that_is_interrupted_loses_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(args: argparse.Namespace) -> bool | None:
        raise KeyboardInterrupt

    monkeypatch.setattr(connected, "_verdict", asked)
    written: list[tuple[str, object]] = []
    bag = SimpleNamespace(state=lambda topic, time, facts: written.append((topic.name, facts)))
    with pytest.raises(KeyboardInterrupt):
        connected.judged(argparse.Namespace(), cast(Bag, bag), {"steps": 3}, True)
    assert written == [("/dxb/summary", {"steps": 3}), ("/dxb/verdict", {"measured": True, "operator": None})]
