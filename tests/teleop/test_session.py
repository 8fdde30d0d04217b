"""A live session with a real simulation: what it records replays as it was, and what stops a take."""

from __future__ import annotations

import json
import resource
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.experts import workplace
from dextera_build.sim.experts.live_operator import Message
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.teleop import protocol, session
from dextera_build.teleop.session import Plan, Session
from dextera_build.teleop.takes import Takes
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.teleop import operators, pages, replays
from tests.teleop.browsing import SPEED
from tests.teleop.test_takes import taken

pytestmark = pytest.mark.slow


class Live:
    """A session whose states are kept, and an operator's means to reach it."""

    def __init__(
        self, bundle: TaskBundle, path: Path, *starts: int, limits: Limits | None = None, limit_s: float = 30.0
    ) -> None:
        self.states: list[dict[str, Any]] = []
        limits = limits or Limits()
        self.takes = Takes(path, synthetic=True, workplace=workplace.of(bundle, limits))
        plan = Plan(1, 0, starts, limit_s, SPEED, Retargeting(heading_rad=0.0), limits)
        self.session = Session(bundle, plan, self.takes, self.publish)
        self.session.start()

    def publish(self, state: bytes) -> None:
        (length,) = struct.unpack_from("<I", state)
        self.states.append(json.loads(state[4 : 4 + length]))

    def say(self, data: bytes) -> None:
        """A frame arrives."""
        arrived = time.perf_counter()

        def read() -> Message:
            frame = protocol.frame(data, arrived, 0.0)
            self.session.measure.of(measured=frame.measured)
            return frame.message

        self.session.inbox.put(read)

    def until(self, key: str, value: Any, seconds: float = 30.0) -> dict[str, Any]:
        """The first new state with that value."""
        for _ in range(round(seconds / 0.01)):
            if self.states and self.states[-1][key] == value:
                return self.states[-1]
            time.sleep(0.01)
        raise AssertionError(f"`{key}` was never {value}: {self.states[-1:]}")

    def end(self) -> None:
        self.session.wish("end")
        self.session.join(20)
        assert not self.session.is_alive()
        assert self.session.error is None


def begin(live: Live) -> None:
    """Start a take; frames come until it is running, as those of a page do, because one may arrive before the wish."""
    live.say(pages.wrists(0.0, 1))
    live.session.wish("start")
    for number in range(2, 1000):
        live.say(pages.wrists(0.0, number))
        if live.states and live.states[-1]["phase"] == "taking":
            return
        time.sleep(0.02)
    raise AssertionError(f"no take has begun: {live.states[-1:]}")


@pytest.fixture
def opened(lifting: TaskBundle, tmp_path: Path) -> Iterator[Callable[..., Live]]:
    """Opens a session with the seeds of its first starts."""
    made: list[Live] = []

    def open_one(*starts: int, limits: Limits | None = None) -> Live:
        made.append(Live(lifting, tmp_path / "made.mcap", *starts, limits=limits))
        return made[-1]

    yield open_one
    for each in made:
        each.end()


@pytest.fixture
def live(opened: Callable[..., Live]) -> Live:
    return opened()


def demonstrate(live: Live, hands: HandStream, sides: Sequence[str] = ("right",)) -> None:
    """Hold the hands open, start, and move them as in the first take, in real time."""
    take = hands.takes[0]
    move(live, hands, *operators.opened(hands, 0), 1.0)
    (_, still), *_ = operators.frames(hands, operators.opened(hands, 0)[1] - 5, take.first)
    while not all(live.session.measure.done(side) for side in sides):
        live.say(still)
        time.sleep(0.05)
    live.session.wish("start")
    live.until("phase", "waiting")
    move(live, hands, take.first, take.last, SPEED)
    live.session.wish("finish")
    live.until("phase", "ready")


def move(live: Live, hands: HandStream, first: int, last: int, speed: float) -> None:
    """Send messages in their time."""
    began = time.perf_counter()
    for due, frame in operators.frames(hands, first, last):
        time.sleep(max(0.0, began + due / speed - time.perf_counter()))
        live.say(frame)


def test_a_take_replays_bit_for_bit_as_the_operator_saw_it(
    runner: RuleRunner, lifting: TaskBundle, opened: Callable[..., Live], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, hands = hand_tasks.shown(runner, lifting, monkeypatch)
    live = opened(hands.takes[0].seed)
    with replays.watched(monkeypatch) as seen:
        demonstrate(live, hands)
        live.until("phase", "ready")
    assert live.states[-1]["kept"] == 1, [state["told"] for state in live.states[-5:]]
    assert len(live.session.own_share) > 20
    recording = HandStream.load(live.takes.path)
    assert recording.takes[0].finger_lengths_m[1] is not None
    for _ in range(2):
        replays.assert_same(runner, lifting, recording, seen)


def test_a_take_with_a_slower_guard_replays_with_the_same_guard(
    runner: RuleRunner, lifting: TaskBundle, opened: Callable[..., Live], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, hands = hand_tasks.shown(runner, lifting, monkeypatch)
    limits = Limits(speed=0.8, force_n=500.0)
    # The hands are those of somebody who saw a faster robot, which this one comes after.
    monkeypatch.setattr(session, "FILTERS", replace(session.FILTERS, lag_m=0.1))
    live = opened(hands.takes[0].seed, limits=limits)
    with replays.watched(monkeypatch) as seen:
        demonstrate(live, hands)
        live.until("phase", "ready")
    assert live.states[-1]["kept"] == 1, [state["told"] for state in live.states[-5:]]
    recording = HandStream.load(live.takes.path)
    assert recording.workplace == workplace.of(lifting, limits)
    replays.assert_same(runner, lifting, recording, seen, lag_m=0.1)
    (shown,) = seen
    robot, rate = lifting.robot, lifting.task.control_hz
    most = limits.speed * np.array([joint.velocity for joint in robot.joints]) / rate
    assert (np.abs(np.diff(shown.executed, axis=0)) <= most + 1e-6).all()
    # Without the guard of its session, the same hands move the robot otherwise.
    fast = replays.followed(runner, lifting, recording, lag_m=0.1, hands={"limits": {"speed": 1.0}})
    assert (np.abs(np.diff(fast.executed, axis=0)) > most + 1e-6).any()


def test_a_guard_that_stops_the_robot_ends_the_take_with_its_reason(
    runner: RuleRunner, lifting: TaskBundle, opened: Callable[..., Live], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, hands = hand_tasks.shown(runner, lifting, monkeypatch)
    live = opened(hands.takes[0].seed, limits=Limits(force_n=1e-3))
    demonstrate(live, hands)
    told = live.until("phase", "ready")["told"]
    assert told.startswith("not kept: the guard stopped the robot: `")
    assert "presses with more than 0.001 N" in told
    assert not live.takes.kept


def test_a_second_wish_for_one_and_the_same_heading_changes_nothing(live: Live) -> None:
    for number, angle in ((1, 40.0), (2, 0.0)):
        live.say(pages.wrists(0.0, number, protocol.WEBXR, np.deg2rad(angle)))
        live.until("measured", [1, 1])
        time.sleep(0.2)
        for _ in range(2):
            live.session.wish("recentre")
            time.sleep(0.2)
        assert np.rad2deg(live.states[-1]["heading"]) == pytest.approx(-40.0)


def test_hands_that_are_not_measured_start_nothing(live: Live) -> None:
    live.say(pages.joints(pages.opened()))
    live.session.wish("start")
    state = live.until("told", "hold the right hand open for 2 s first")
    assert state["phase"] == "ready"
    assert state["measured"] == [0, 0]


def test_keys_move_the_robot_and_a_silent_connection_holds_and_then_stops(live: Live) -> None:
    live.say(pages.wrists(0.0, 1))
    live.session.wish("start")
    for number in range(2, 60):
        live.say(pages.wrists(number / 60, number))
        time.sleep(0.015)
    moved = live.until("phase", "taking")
    assert moved["clutch"] == [True, True]
    assert not live.states[-1]["held"]["arm"]
    silent = live.until("silent", True)
    assert silent["phase"] == "taking"
    stopped = live.until("phase", "ready")
    assert stopped["told"] == "the connection was silent for 2 s, so the take was stopped"
    assert not live.takes.kept


def test_frames_that_are_all_refused_are_a_silent_connection(live: Live) -> None:
    begin(live)
    for _ in range(400):
        live.say(b"no frame of hands")
        if live.states[-1]["phase"] == "ready":
            break
        time.sleep(0.015)
    assert live.until("phase", "ready", 1.0)["told"] == "the connection was silent for 2 s, so the take was stopped"


def test_discard_ends_a_take_and_finish_waits_for_the_robot_to_rest(live: Live) -> None:
    unfinished = "the task was not done when the operator finished: the object is too low"
    for what, told in (("discard", "discarded"), ("finish", unfinished)):
        begin(live)
        live.session.wish(what)
        assert live.until("phase", "ready")["told"] == told
    assert not live.takes.path.exists()


@pytest.mark.parametrize("moves", [False, True])
def test_an_end_during_a_take_discards_it_and_ends_the_session(live: Live, moves: bool) -> None:
    if moves:
        begin(live)
    else:
        live.say(pages.wrists(0.0, 1))
        live.until("measured", [1, 1])
        live.session.inbox.take(0)
        live.session.wish("start")
        live.until("phase", "waiting")
    live.session.wish("end")
    ended = live.until("phase", "ended")
    live.session.join(10)
    assert not live.session.is_alive()
    assert ended["told"] == "the take that was running was discarded"
    assert live.session.discarded
    assert not live.takes.path.exists()


def test_an_end_between_takes_discards_nothing(live: Live) -> None:
    begin(live)
    live.session.wish("discard")
    live.until("phase", "ready")
    live.session.wish("end")
    assert live.until("phase", "ended")["told"] == ""
    assert not live.session.discarded


def test_a_full_disk_starts_no_take(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = type(session.shutil.disk_usage("."))
    monkeypatch.setattr(session.shutil, "disk_usage", lambda path: usage(100, 100, 0))
    live.say(pages.wrists(0.0, 1))
    time.sleep(0.2)
    live.session.wish("start")
    live.until("told", f"the disk of {live.takes.path.parent} is full: free 50 MB first")


def test_a_disk_that_fills_while_a_take_is_written_loses_nothing(live: Live) -> None:
    """The limit on the size of files is the system's own error."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        live.takes.add(taken(7))
        live.session.wish("end")
        told = live.until("told", "the recording is not written yet: File too large; free the disk and end again")
        assert told["phase"] == "ready"
        assert told["unsaved"] == "File too large"
        assert not live.takes.path.exists()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    live.session.wish("end")
    live.until("phase", "ended")
    assert [take.seed for take in HandStream.load(live.takes.path).takes] == [7]
