"""A robot with two arms of which one is moved, or one after the other: a real session on a plain table.

A program made the hands; no person and no headset took part.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import human_hand, quaternions
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.teleop import protocol
from dextera_build.teleop.session import Session
from dextera_build.teleop.takes import Kept, Takes
from dextera_build.testing import RuleRunner
from tests import factories, openarm_tasks
from tests.robots.robot_recipes import built
from tests.teleop import replays
from tests.teleop.test_session import Live

pytestmark = pytest.mark.slow
LIMIT_S = 2.0


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> TaskBundle:
    robot = built("openarm_revo1", tmp_path_factory.mktemp("robot"))
    can = factories.box_asset(factories.pose(0.0, -0.08, 0.0), (0.05, 0.05, 0.14), 0.15)
    return openarm_tasks.bundle(robot, LiftGoal(height_m=0.08), {"can": can}, "can", timeout_s=LIMIT_S)


@pytest.fixture
def opened(bundle: TaskBundle, tmp_path: Path) -> Iterator[Callable[..., Live]]:
    """Opens a session of the task, or of one whose `limbs` must move."""
    made: list[Live] = []

    def open_one(*limbs: str) -> Live:
        asked = bundle.model_copy(update={"task": bundle.task.model_copy(update={"limbs": limbs})})
        made.append(Live(asked, tmp_path / "made.mcap", limit_s=LIMIT_S))
        return made[-1]

    yield open_one
    for each in made:
        each.end()


class Hands:
    """Hands that rise slowly, and are sent to a session."""

    def __init__(self, live: Live) -> None:
        self._live, self._number = live, 0

    def send(self, tracked: tuple[int, int], clutch: tuple[int, int] = (1, 1), bent: str = "") -> None:
        """A message; hand `bent` is not open."""
        self._number += 1
        hands = np.stack([self._joints(hand, side == bent) for hand, side in enumerate(("left", "right"))])
        head = [float("nan")] * 7
        facts = (*tracked, *clutch, 0.0, 0.0, *head)
        data = protocol.HEAD.pack(self._number, protocol.JOINTS, 25, protocol.BASE, 0.0, *facts)
        self._live.say(data + hands.astype("<f4").tobytes())
        time.sleep(0.014)

    def _joints(self, hand: int, bent: bool) -> np.ndarray:
        angles = human_hand.open_angles() + np.deg2rad([[0] * 4, *[[0, 30, 30, 30]] * 4]) * bent
        points, turns = human_hand.Hand().joints(angles, ("left", "right")[hand])
        points = points + np.array([0.0, 0.2 - 0.4 * hand, 1.0 + 2e-4 * self._number])
        return np.concatenate([points, quaternions.from_matrices(turns)[:, [1, 2, 3, 0]]], axis=1)

    def measured(self, *sides: str, tracked: tuple[int, int], bent: str = "") -> None:
        """Hold hands open until the session has measured some."""
        for _ in range(2000):
            if all(self._live.session.measure.done(side) for side in sides):
                return
            self.send(tracked, bent=bent)
        raise AssertionError(f"not measured: {self._live.states[-1]}")

    def until(self, phase: str, tracked: tuple[int, int], clutch: tuple[int, int] = (1, 1), bent: str = "") -> None:
        """Send until the session comes to a phase."""
        for _ in range(2000):
            if self._live.states[-1]["phase"] == phase:
                return
            self.send(tracked, clutch, bent)
        raise AssertionError(f"never {phase}: {self._live.states[-1]}")


def shown(monkeypatch: pytest.MonkeyPatch) -> tuple[list[Episode], list[Kept]]:
    """Episodes of sessions as their operators saw them, and what they would have kept of these, successful or not."""
    episodes: list[Episode] = []
    takes: list[Kept] = []
    run, judge = Driver.run, Session._judge

    def kept(self: Driver, *words: Any, **named: Any) -> Episode:
        episodes.append(run(self, *words, **named))
        return episodes[-1]

    def judged(self: Session, episode: Episode, take: Kept) -> None:
        takes.append(take)
        judge(self, episode, take)

    monkeypatch.setattr(Driver, "run", kept)
    monkeypatch.setattr(Session, "_judge", judged)
    return episodes, takes


def assert_replays(runner: RuleRunner, bundle: TaskBundle, path: Path, take: Kept, seen: Episode) -> HandStream:
    """The robot does with a recording of the take what it did in the session; the recording."""
    takes = Takes(path, synthetic=True)
    takes.add(take)
    recording = HandStream.load(path)
    replayed = replays.followed(runner, bundle, recording)
    count = min(len(seen.action), len(replayed.action))
    assert count > 0.8 * len(seen.action)
    for name in ("action", "executed", "hand"):
        one, other = (getattr(each, name)[:count] for each in (seen, replayed))
        assert one.tobytes() == other.tobytes(), name
    return recording


@pytest.mark.parametrize("limbs", [(), ("right",)])
def test_a_hand_that_was_not_measured_moves_nothing(
    runner: RuleRunner,
    bundle: TaskBundle,
    opened: Callable[..., Live],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    limbs: tuple[str, ...],
) -> None:
    episodes, takes = shown(monkeypatch)
    live = opened(*limbs)
    hands = Hands(live)
    hands.measured("right", tracked=(2, 2), bent="left")
    assert not live.session.measure.done("left")
    live.session.wish("start")
    hands.until("taking", (2, 2), bent="left")
    hands.until("ready", (2, 2), bent="left")
    # The task was not done in its time, and nothing else ended the take.
    assert live.states[-1]["told"] == "not kept: not done within 2 s: the object is too low"
    (seen,), (take,) = episodes, takes
    assert len(seen.action) == LIMIT_S * bundle.task.control_hz
    assert np.isfinite(seen.hand).all()
    rise = seen.hand[-1, :, 2] - seen.hand[0, :, 2]
    assert abs(rise[0]) < 1e-6
    assert rise[1] > 0.01
    recording = assert_replays(runner, live.session.environment.bundle, tmp_path / "take.mcap", take, seen)
    assert recording.clutch.any(axis=0).tolist() == [False, True]
    assert recording.takes[0].finger_lengths_m[0] is None


def test_no_take_begins_without_any_measured_hand_nor_with_another_one(opened: Callable[..., Live]) -> None:
    live = opened()
    hands = Hands(live)
    for _ in range(5):
        hands.send((2, 2), bent="left")
    live.session.wish("start")
    live.until("told", "hold the left or the right hand open for 2 s first")
    hands.measured("right", tracked=(2, 2), bent="left")
    live.session.wish("start")
    hands.until("waiting", (2, 0), bent="left")
    for _ in range(30):
        hands.send((2, 2), (1, 0), bent="left")
    assert live.states[-1]["phase"] == "waiting"
    live.session.wish("discard")
    live.until("phase", "ready")


@pytest.mark.parametrize("limbs", [(), ("left", "right")])
def test_a_hand_whose_clutch_closes_later_joins_the_take(
    runner: RuleRunner,
    bundle: TaskBundle,
    opened: Callable[..., Live],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    limbs: tuple[str, ...],
) -> None:
    episodes, takes = shown(monkeypatch)
    live = opened(*limbs)
    hands = Hands(live)
    hands.measured("left", "right", tracked=(2, 2))
    live.session.wish("start")
    hands.until("taking", (2, 2), (0, 1))
    while live.states[-1]["seconds"] < LIMIT_S / 3:
        hands.send((2, 2), (0, 1))
    # A limb that the task needs is commanded before, and held.
    assert live.states[-1]["held"] == ({"left": True, "right": False} if limbs else {"right": False})
    hands.until("ready", (2, 2))
    (seen,), (take,) = episodes, takes
    third = len(seen.hand) // 3
    assert abs(seen.hand[third, 0, 2] - seen.hand[0, 0, 2]) < 1e-6
    assert (seen.hand[-1, :, 2] - seen.hand[0, :, 2] > 0.01).all()
    assert take.sides == [0, 1]
    recording = assert_replays(runner, live.session.environment.bundle, tmp_path / "take.mcap", take, seen)
    assert recording.clutch[[0, -1]].tolist() == [[False, True], [True, True]]
