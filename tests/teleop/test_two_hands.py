"""Two hands in a live session of OB BimanualLiftBox, in the twin: a take is kept, and replays bit for bit.

A program made the hands from the motion of the scripted operator; no person and no headset took part.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.api import Project, Result
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.experts import workplace
from dextera_build.testing import RuleRunner
from tests.hand_tasks import STEADY
from tests.teleop import replays
from tests.teleop.test_session import Live, demonstrate

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]
REPO = Path(__file__).parents[2]
SIDES = ("left", "right")
ATTEMPTS = 3
"""How often the take is demonstrated at most: the session runs in real time, on a machine that tests other things."""


@pytest.fixture(scope="module")
def built() -> Result:
    """The task and a demonstration by the scripted operator, in the store of this checkout."""
    result = Project.find(REPO).build("task/ob/bimanual_lift_box", "sources", settings={"sources.episodes": 3})
    assert result.ok, result.errors
    return result


@pytest.fixture(scope="module")
def bundle(built: Result) -> TaskBundle:
    found = built.artifact("task")
    assert isinstance(found, TaskBundle)
    return found


@pytest.fixture(scope="module")
def hands(built: Result, bundle: TaskBundle, runner: RuleRunner) -> HandStream:
    """Both hands of somebody who lifts the box."""
    shown = built.artifact("sources")
    assert isinstance(shown, Episodes)
    made: HandStream = runner.run(
        "reference.hands", robot=bundle.robot, episodes=shown, options={"unsteady": STEADY, "takes": 1}
    )
    return made


def test_a_take_with_both_hands_is_kept_and_replays_bit_for_bit(
    runner: RuleRunner, bundle: TaskBundle, hands: HandStream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bundle.task.limbs == SIDES
    live = Live(bundle, tmp_path / "made.mcap", hands.takes[0].seed or 0)
    try:
        with replays.watched(monkeypatch) as seen:
            for _ in range(ATTEMPTS):
                demonstrate(live, hands, SIDES)
                if live.states[-1]["kept"]:
                    break
        assert live.states[-1]["kept"] == 1, [state["told"] for state in live.states[-5:]]
    finally:
        live.end()
    recording = HandStream.load(live.takes.path)
    assert recording.workplace == workplace.of(bundle)
    take = recording.takes[0]
    assert all(lengths is not None for lengths in take.finger_lengths_m)
    rows = slice(take.first, take.last)
    # Both hands moved the robot, and both of its hands carried the box.
    assert recording.clutch[rows].any(axis=0).tolist() == [True, True]
    (shown,) = seen
    assert shown.success
    assert {segment.name for segment in shown.segments} == {"approach", "manipulate"}
    ways = np.linalg.norm(shown.hand[-1, :, :3] - shown.hand[0, :, :3], axis=1)
    assert (ways > 0.05).all()
    replays.assert_same(runner, bundle, recording, seen)


def test_without_one_of_the_hands_no_take_begins(bundle: TaskBundle, hands: HandStream, tmp_path: Path) -> None:
    one = hands.model_copy(
        update={
            "tracking": hands.tracking * np.array([0, 1], np.uint8),
            "positions": np.where(np.array([True, False])[None, :, None, None], np.nan, hands.positions),
            "rotations": np.where(np.array([True, False])[None, :, None, None], np.nan, hands.rotations),
        }
    )
    live = Live(bundle, tmp_path / "made.mcap", hands.takes[0].seed or 0)
    try:
        with pytest.raises(AssertionError, match="hold the left hand open for 2 s first"):
            demonstrate(live, one, ("right",))
    finally:
        live.end()
