"""What a long build says of itself: how many nodes are done, of how many, and how far the running ones are."""

from __future__ import annotations

import io
import threading
import time

from rich.console import Console as Terminal

from dextera_build.cli.consoles.live import LiveConsole
from dextera_build.cli.consoles.plain import PlainConsole
from dextera_build.cli.consoles.record import Record, counted
from dextera_build.runs.events import NodeFinished, NodeProgress, NodeStarted, RunSized, RunStarted
from tests.cli.test_consoles import Tty, until


def test_the_number_of_nodes_is_known_when_groups_have_opened() -> None:
    record = Record()
    record.follow(RunStarted(0.0, "1", "r", [], "cpu", "0", calls=9, groups=2))
    assert record.total == "9"
    record.follow(RunSized(0.0, nodes=4, unopened=1))
    assert record.total == "4+"
    record.follow(RunSized(0.0, nodes=10, unopened=2))  # `body` opened and holds a group for each copy
    assert record.total == "10+"
    record.follow(RunSized(0.0, nodes=1016, unopened=0))
    assert record.total == "1,016"


def test_only_nodes_that_need_no_more_work_are_done() -> None:
    record = Record()

    def finish(node: str, status: str, rule: str = "a.b") -> None:
        record.follow(NodeFinished(1.0, node, rule, None, status, None, None, 0.0))  # type: ignore[arg-type]

    finish("a", "ran")
    finish("b", "cached")
    finish("b", "ran")  # its bytes were lost
    finish("c", "failed")
    finish("d", "waits")
    finish("e", "cancelled")
    finish("body", "failed", "each")
    assert record.done == 2
    assert counted(record) == "2 of 0 nodes, 0 running, 2 failed"


def test_plain_says_of_a_long_node_how_far_it_is_and_no_more_often_than_asked() -> None:
    clock_now = [1000.0]
    stream = io.StringIO()
    with PlainConsole(stream, beat_s=30.0, now=lambda: clock_now[0]) as shown:
        shown(RunStarted(1000.0, "1", "r", [], "cpu", "0", 3, 1))
        shown(RunSized(1000.0, 12, 1))
        shown(NodeFinished(1000.0, "start", "a.b", None, "cached", "k", "o", 1.0))
        shown(NodeStarted(1000.0, "train", "learn.act", "cpu", "k", 1200.0))
        shown(NodeStarted(1010.0, "film", "a.b", None, "k"))
        for second in range(1, 91):
            clock_now[0] = 1000.0 + second
            shown(NodeProgress(clock_now[0], "train", second * 10, 4000, "steps"))
            shown.tick()
        shown(NodeFinished(1090.0, "train", "learn.act", "cpu", "ran", "k", "o", 90.0))
        clock_now[0] = 1130.0
        shown.tick()
    beats = [line.strip() for line in stream.getvalue().splitlines() if "▸" in line]
    assert beats == [
        "▸  train  30 s of ~20 min  300/4,000 steps   (1 of 12+ nodes, 2 running)",
        "▸  film  30 s   (1 of 12+ nodes, 2 running)",
        "▸  train  60 s of ~20 min  600/4,000 steps   (1 of 12+ nodes, 2 running)",
        "▸  film  60 s   (1 of 12+ nodes, 2 running)",
        "▸  train  90 s of ~20 min  900/4,000 steps   (1 of 12+ nodes, 2 running)",
        "▸  film  2 min 00 s   (2 of 12+ nodes, 1 running)",
    ]


def test_plain_beats_by_itself_and_stops_with_the_run() -> None:
    stream = io.StringIO()
    with PlainConsole(stream, beat_s=0.1) as shown:
        shown(RunStarted(time.time(), "1", "r", [], "cpu", "0", 1, 0))
        shown(NodeStarted(time.time(), "train", "learn.act", "cpu", "k"))
        began = time.monotonic()
        until(lambda: stream.getvalue().count("▸  train") >= 3)
        shown(NodeFinished(time.time(), "train", "learn.act", "cpu", "ran", "k", "o", 0.5))
        beats = stream.getvalue().count("▸  train")
        assert beats <= (time.monotonic() - began) / 0.1 + 1
        time.sleep(0.3)
        assert stream.getvalue().count("▸  train") == beats
    assert not any(thread.name == "console" and thread.is_alive() for thread in threading.enumerate())


def test_live_foot_says_that_the_number_of_nodes_is_open() -> None:
    stream = Tty()
    terminal = Terminal(file=stream, force_terminal=True, width=90, height=30, legacy_windows=False)
    with LiveConsole(stream, terminal=terminal) as shown:
        shown(RunStarted(time.time(), "1", "r", [], "cpu", "0", 40, 1))
        shown(RunSized(time.time(), 12, 1))
        shown(NodeStarted(time.time(), "train", "learn.act", "cpu", "k"))
        shown(NodeProgress(time.time(), "train", 5, 10, "steps"))
        until(lambda: "0 of 12+ nodes, 1 running" in stream.getvalue())
        until(lambda: "5/10 steps" in stream.getvalue())
