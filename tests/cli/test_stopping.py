"""Keys of the terminal and of an input device stop a run; a device that goes away does, too."""

from __future__ import annotations

import os
import pty
import sys
import threading
import time
from pathlib import Path

import pytest

from dextera_build.cli.robot import stopping
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
