"""The inbox of a live operator: only the newest message counts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from dextera_build.sim.experts.live_operator import TICKS_HZ, Inbox, Message
from dextera_build.teleop import protocol
from tests.teleop import pages


def message(number: int) -> Callable[[], Message]:
    return lambda: protocol.frame(pages.wrists(0.0, number), time.perf_counter(), 0.0).message


def test_a_message_that_is_refused_is_none():
    inbox = Inbox()
    inbox.put(lambda: protocol.frame(b"", 0.0, 0.0).message)
    assert inbox.take(0) is None


def test_messages_that_are_refused_are_no_sign_of_life():
    inbox = Inbox()
    inbox.put(message(1))
    assert inbox.take(0) is not None
    heard = inbox.arrived
    for _ in range(3):
        inbox.put(lambda: protocol.frame(b"", 0.0, 0.0).message)
        inbox.take(0)
        assert inbox.arrived == heard
    # The session has not read this one yet, and cannot know whether it is better.
    inbox.put(message(2))
    assert inbox.arrived == heard
    assert inbox.take(0) is not None
    assert inbox.arrived > heard
    inbox.put(message(3))
    assert inbox.arrived <= time.perf_counter()


def test_a_message_that_a_slow_simulation_has_not_read_is_one():
    inbox = Inbox()
    inbox.put(message(1))
    assert inbox.take(0) is not None
    heard = inbox.arrived
    inbox.put(message(2))
    assert inbox.arrived > heard


def test_an_older_message_that_waits_is_dropped():
    inbox = Inbox()
    for number in (1, 2, 3):
        inbox.put(message(number))
    found = inbox.take(0)
    assert found is not None
    assert found.number == 3
    assert inbox.dropped == 2
    assert 0.0 < inbox.arrived <= time.perf_counter()
    assert inbox.take(0) is None
    assert inbox.take(-1.0) is None


def test_a_wait_ends_with_a_message_or_a_wish_but_not_later_than_asked():
    inbox = Inbox()
    began = time.perf_counter()
    assert inbox.take(0.05) is None
    assert time.perf_counter() - began >= 0.04
    threading.Timer(0.05, inbox.put, [message(7)]).start()
    found = inbox.take(10.0)
    assert found is not None
    assert found.number == 7
    threading.Timer(0.05, inbox.wake).start()
    began = time.perf_counter()
    assert inbox.take(10.0) is None
    assert time.perf_counter() - began < 5.0


def test_ticks_are_whole_nanoseconds_whose_differences_are_exact():
    assert 10**9 % TICKS_HZ == 0
    times = [ticks / TICKS_HZ for ticks in (0, 1, 7, 513, 10**7)]
    for begin in (0.0, 1234.5, 86_400.0):
        assert [(begin + each) - begin for each in times] == times
