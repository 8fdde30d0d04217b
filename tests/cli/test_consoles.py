"""What a build shows: text of every console, colour, folding, narrow terminals, many threads."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console as Terminal

from dextera_build.cli.consoles import can_move, console, lines
from dextera_build.cli.consoles.live import LiveConsole
from dextera_build.cli.consoles.record import Running, clock, foot
from dextera_build.cli.errors import wants_colour
from dextera_build.rule.context import Outcome
from dextera_build.runs.events import (
    BytesMissed,
    Event,
    NodeFinished,
    NodeLog,
    NodeProgress,
    NodeStarted,
    RunFinished,
    RunStarted,
)
from tests.report.fabricate import Spec, fabricate


class Tty(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


class Ascii(io.StringIO):
    """A stream of an old locale."""

    encoding = "ANSI_X3.4-1968"


def show(kind: str, events: list[Event], stream: io.StringIO | None = None, **more: bool) -> str:
    stream = stream or io.StringIO()
    with console(kind, stream, **more) as shown:
        for event in events:
            shown(event)
    return stream.getvalue()


def unpainted(text: str) -> str:
    return re.sub(r"\x1b\[[?\d;]*[A-Za-z]", "", text)


def screen(written: str) -> str:
    """What stands on the terminal in the end: knows new line, return, cursor up and erase, as rich uses them."""
    rows, row, column = [""], 0, 0
    for move, kind, char in re.findall(r"\x1b\[([?\d;]*)([A-Za-z])|(.|\n)", written):
        if kind == "A":
            row -= int(move or 1)
        elif kind == "K":
            rows[row] = ""
        elif char == "\r":
            column = 0
        elif char == "\n":
            row, column = row + 1, 0
            rows += [""] * (row + 1 - len(rows))
        elif char:
            rows[row] = rows[row].ljust(column)[:column] + char + rows[row][column + 1 :]
            column += 1
        assert row >= 0
    return "\n".join(line.rstrip() for line in rows)


def until(is_so: Callable[[], bool]) -> None:
    """Wait for what a thread of a console does when the machine lets it."""
    deadline = time.monotonic() + 60
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def live(events: list[Event], columns: int = 100) -> str:
    stream = Tty()
    terminal = Terminal(
        file=stream, force_terminal=True, width=columns, height=30, highlight=False, legacy_windows=False
    )
    with LiveConsole(stream, terminal=terminal) as shown:
        for event in events:
            shown(event)
    return screen(stream.getvalue())


def test_plain_log_of_a_build() -> None:
    text = show("plain", fabricate("mixed")[0])
    assert text.startswith("plan   17 calls, 1 open group\n")
    assert not re.search(r"\n  =  .*cached", text)
    assert "\n       body opened: 4 copies (laptop, blue_mug, box, gray_bowl)\n" in text
    assert re.search(r"\n  \+  body\[laptop\]\.parts +1\.4 s +cpu +1 hinge, 0–131°\n", text)
    assert re.search(r"\n  ↓  body\[laptop\]\.urdf +0\.20 s +2 links, 1 joint\n", text)
    assert text.endswith(
        "\n\nbuilt twin/laptop_scene   38 nodes: 24 ran, 11 cached, 3 fetched   55.4 s (74.0 s saved)\n"
    )


@pytest.mark.parametrize("kind", ["plain", "live"])
def test_one_line_where_everything_is_cached(kind: str) -> None:
    events = fabricate("cached")[0]
    text = live(events) if kind == "live" else show(kind, events)
    assert text == "twin/laptop_scene is up to date   38 nodes   0.20 s\n"


@pytest.mark.parametrize("kind", ["plain", "live"])
def test_failure_says_what_waits_and_how_to_see_the_log(kind: str) -> None:
    events = fabricate("failed")[0]
    text = live(events) if kind == "live" else show(kind, events)
    assert re.search(r"  ✗  body\[box\]\.mesh +12\.0 s +primitives +214 open edges, 0 allowed", text)
    assert re.search(r"  ·  11 nodes +wait +for body\[box\]\.mesh", text)
    assert "error[DXB-B201]: body[box].mesh failed its check: 214 open edges, 0 allowed\n" in text
    assert "   log         dxb log 0142 'body[box].mesh'\n" in text
    assert text.rstrip().endswith("failed twin/laptop_scene   38 nodes: 26 ran, 1 failed, 11 wait   66.5 s")
    assert "up to date" not in text
    assert "dxb view" not in text


def test_interrupted_run_is_stopped_and_not_failed() -> None:
    last = RunFinished(
        time=2, ok=False, seconds=2, counts={"cached": 2, "cancelled": 1}, saved_seconds=0, interrupted=True
    )
    assert lines.plain(lines.summary("twin/x", last)) == "stopped twin/x   3 nodes: 2 cached, 1 cancelled   2.0 s"
    assert (
        lines.plain(lines.summary("twin/x", RunFinished(3.0, False, 2.0, {}, 0.0))) == "failed twin/x   0 nodes   2.0 s"
    )


def test_a_run_that_stops_in_the_middle_still_shows_what_was_held_back() -> None:
    text = show("plain", fabricate("cached")[0][:4])
    assert text == "plan   17 calls, 1 open group\n"


def test_quiet_says_nothing_but_failures() -> None:
    assert show("none", fabricate("mixed")[0]) == ""
    assert show("none", fabricate("failed")[0]).startswith("error[DXB-B201]: body[box].mesh failed its check")


def test_jsonl_is_the_event_stream() -> None:
    events = fabricate("failed")[0]
    read = [json.loads(line) for line in show("jsonl", events).splitlines()]
    assert [line["event"] for line in read] == [event.kind for event in events]
    assert read == [json.loads(event.to_line()) for event in events]


def test_live_becomes_plain_where_nothing_can_move(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.get_terminal_size", lambda fd: __import__("os").terminal_size((80, 24)))
    monkeypatch.setattr(Tty, "fileno", lambda self: 2)
    monkeypatch.setenv("TERM", "xterm")
    assert can_move(Tty())
    assert not can_move(io.StringIO())
    monkeypatch.setenv("TERM", "dumb")
    assert not can_move(Tty())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("os.get_terminal_size", lambda fd: __import__("os").terminal_size((30, 24)))
    assert not can_move(Tty())
    assert type(console("live", Tty())).__name__ == "PlainConsole"


def test_no_colour_unless_a_terminal_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    events = fabricate("mixed")[0]
    assert wants_colour(Tty())
    painted = show("plain", events, Tty())
    assert "\x1b[32m" in painted
    assert unpainted(painted) == show("plain", events)
    monkeypatch.setenv("NO_COLOR", "1")
    assert show("plain", events, Tty()) == show("plain", events)


def test_an_ascii_stream_gets_no_character_that_it_cannot_write() -> None:
    text = show("plain", fabricate("mixed")[0], Ascii())
    assert re.search(r"  v  body\[laptop\]\.urdf", text)
    text = show("plain", fabricate("failed")[0], Ascii())
    assert re.search(r"  x  body\[box\]\.mesh", text)
    text.encode("ascii")


def test_live_shows_the_lines_of_a_plain_log_and_leaves_nothing_at_the_foot() -> None:
    text = live(fabricate("mixed")[0])
    assert text == show("plain", fabricate("mixed")[0])
    assert text.rstrip().endswith("(74.0 s saved)")
    assert "running" not in text
    assert "▸" not in text


def test_live_lines_fit_a_narrow_terminal() -> None:
    events = fabricate("mixed")[0]
    assert max(len(line) for line in live(events[:-1], columns=44).splitlines()) <= 44


def test_live_ticks_while_a_node_runs_and_debounces_a_flood() -> None:
    stream = Tty()
    terminal = Terminal(file=stream, force_terminal=True, width=80, height=30, legacy_windows=False)
    node = Spec("slow", "a.b", None, 1.0, "", [], "Mesh")
    start = fabricate("cold", nodes=[node])[0][0]
    with LiveConsole(stream, terminal=terminal) as shown:
        shown(start)
        shown(NodeStarted(time=time.time(), node="slow", rule="a.b", backend=None, key="0" * 64, last_seconds=9.0))
        began = time.monotonic()
        for done in range(5000):
            shown(NodeProgress(time=time.time(), node="slow", done=done, total=5000, what="steps"))
        until(lambda: "4,999/5,000 steps" in stream.getvalue())
        flood = stream.getvalue().count("slow")
        assert flood <= (time.monotonic() - began) / 0.05 + 2
        until(lambda: stream.getvalue().count("slow") >= flood + 2)


def test_a_node_whose_result_and_bytes_are_fetched_has_one_line() -> None:
    def finished(node: str, status: Any) -> NodeFinished:
        return NodeFinished(1.0, node, "a.b", None, status, "k", "o", 0.1, remote="shared")

    stream = io.StringIO()
    with console("plain", stream) as shown:
        shown(finished("photo", "fetched"))
        shown(BytesMissed(1.0, "photo", "mesh"))
        shown(finished("photo", "fetched"))
        shown(finished("known", "cached"))
        shown(BytesMissed(1.0, "known", "mesh"))
        shown(finished("known", "fetched"))
        shown(finished("mesh", "ran"))
    told = stream.getvalue().splitlines()
    assert [line.split()[1] for line in told if "photo" in line] == ["photo"]
    assert sum("known" in line for line in told) == 2
    assert any("known: its result is bare" in line for line in told)


def test_live_close_twice_and_without_events() -> None:
    stream = Tty()
    shown = console("plain", stream)
    shown.close()
    shown.close()
    moving = LiveConsole(stream, terminal=Terminal(file=stream, force_terminal=True, width=80))
    moving.close()
    moving.close()


def running(node: str, last: float | None, progress: NodeProgress | None = None) -> Running:
    return Running(
        NodeStarted(time=100.0, node=node, rule="a.b", backend="cpu", key="0" * 64, last_seconds=last), progress
    )


def text_of(shown: list[lines.Line]) -> list[str]:
    return [lines.plain(line).rstrip() for line in shown]


def test_foot_shows_clock_expected_time_and_progress() -> None:
    half = NodeProgress(time=101, node="b", done=4, total=8, what="hypotheses")
    shown = text_of(foot([running("a", 40.0), running("b", None, half), running("c", None)], 110.0, 100, 10))
    assert shown == ["  ▸  a  10 s of ~40 s  cpu", "  ▸  b  10 s  4/8 hypotheses", "  ▸  c  10 s  cpu"]
    many = NodeProgress(time=101, node="d", done=1200, total=0, what="steps\x1b[2J")
    assert text_of(foot([running("d", None, many)], 110.0, 100, 10))[0].endswith("1,200 steps [2J")


def test_foot_drops_what_does_not_fit() -> None:
    many = [running(f"body[object_with_a_long_name_{i}].mesh", None) for i in range(20)]
    shown = text_of(foot(many, 110.0, 60, 5))
    assert len(shown) == 5
    assert shown[-1] == "     and 16 nodes more"
    assert "…" in shown[0]


def test_clock_counts_whole_seconds() -> None:
    assert [clock(0.4), clock(7.9), clock(99.9), clock(130.2)] == ["0 s", "7 s", "99 s", "2 min 10 s"]


def test_lines_from_many_threads_are_not_torn(tmp_path: Path) -> None:
    path = tmp_path / "log"
    with path.open("w") as stream, console("plain", stream, verbose=True) as shown:
        shown(RunStarted(0.0, "1", "r", [], "cpu", "0", 8, 0))
        shown(NodeStarted(0.0, "n0", "a.b", None, "k"))

        def work(number: int) -> None:
            for i in range(200):
                shown(NodeLog(time=0.0, node=f"n{number}", text=f"line {i} " + "x" * 200))

        threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    written = path.read_text().splitlines()[1:]
    assert len(written) == 1600
    assert all(re.fullmatch(r"     n\d \| line \d+ x{200}", line) for line in written)


def test_a_line_of_a_rule_stays_one_line_and_cannot_move_the_cursor() -> None:
    event = NodeFinished(
        time=1, node="a", rule="r.a", backend=None, status="ran", key="k", output="o", seconds=1, line="o\x1b[2Jne\ntwo"
    )
    assert lines.plain(lines.node(event)).endswith("  o [2Jne")


def finished(status: Any, line: str) -> NodeFinished:
    key = "a" * 64
    return NodeFinished(0.0, "photo", "capture.folder", None, status, key, key, 1.0, line=line)


@pytest.mark.parametrize("status", ["ran", "cached"])
def test_warnings_of_a_rule_stand_below_its_line_even_if_its_result_was_known(status: str) -> None:
    outcome = Outcome("12 things", ["one is cut", "the depth is shifted; by 30 px"])
    event = finished(status, outcome.told)
    assert "\n" not in outcome.told, "results travel in bundles as printable text"
    shown = lines.line(event, verbose=False)
    assert shown is not None
    first, second, third = lines.plain(shown).split("\n")
    assert first.endswith("12 things")
    assert second.strip() == "warning: one is cut"
    assert third.strip() == "warning: the depth is shifted; by 30 px"
    assert Outcome("", ["only this"]).told == "warning: only this"
    assert lines.line(finished("cached", "12 things"), verbose=False) is None


def test_nodes_that_never_ran_are_told_at_the_end_by_what_they_wait_for() -> None:
    def left(node: str, status: str, *blockers: str) -> NodeFinished:
        return NodeFinished(1.0, node, "a.b", None, status, None, None, 0.0, blocked_by=list(blockers))  # type: ignore[arg-type]

    events = [left("c", "cancelled"), left("a", "waits", "x"), left("b", "waits", "y")]
    events += [left(f"z{i}", "waits", "y") for i in range(5)]
    shown = [" ".join(lines.plain(line).split()) for line in lines.left_over(events)]
    assert shown == ["· a waits for x", "· 6 nodes wait for y", "- c cancelled"]


def test_plain_and_errors_start_without_heavy_packages() -> None:
    code = (
        "import sys, io\n"
        "from dextera_build.cli.consoles import console\n"
        "from dextera_build.cli.errors import render\n"
        "console('plain', io.StringIO())\n"
        "print([name for name in ('rich', 'numpy', 'PIL', 'pydantic') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
