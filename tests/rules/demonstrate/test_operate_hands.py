"""demonstrate.operate by recorded hands: what is refused, and that a robot follows them the same each time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream, Take
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.experts import workplace
from dextera_build.sim.experts.hand_operator import SETTLE_S
from dextera_build.testing import RuleRunner
from tests import hand_tasks, task_bundles
from tests.hand_streams import stream
from tests.robots.robot_recipes import built


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("rules"))


@pytest.fixture(scope="module")
def lifting(runner: RuleRunner, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], TaskBundle]:
    """A can on a table in front of a robot."""
    made: dict[str, TaskBundle] = {}

    def get(name: str) -> TaskBundle:
        if name not in made:
            robot = built(name, tmp_path_factory.mktemp(name))
            made[name] = hand_tasks.lift_can(runner, robot, list(robot.limb_names) if len(robot.limbs) > 1 else [])
        return made[name]

    return get


def followed(runner: RuleRunner, bundle: TaskBundle, recording: HandStream, **options: Any) -> Episodes:
    found: Episodes = runner.run(
        "demonstrate.operate", backend="hands", bundle=bundle, recording=recording, options={"attempts": 9} | options
    )
    return found


def test_hands_need_a_recording_and_a_script_follows_none(runner: RuleRunner) -> None:
    bundle = task_bundles.lift()
    with pytest.raises(RuleError, match="there is no recording of hands to follow") as caught:
        runner.run("demonstrate.operate", backend="hands", bundle=bundle)
    assert "recording: $..." in caught.value.hint
    with pytest.raises(RuleError, match="the scripted operator follows no recording") as caught:
        runner.run("demonstrate.operate", backend="mujoco", bundle=bundle, recording=stream(20))
    assert "backend: hands" in caught.value.hint


def test_a_robot_without_a_hand_is_refused(runner: RuleRunner) -> None:
    with pytest.raises(RuleError, match="limb `arm` has no hand that an operator's hand can move") as caught:
        followed(runner, task_bundles.lift(), stream(20))
    assert caught.value.code == "DXB-B520"
    assert "hands: {arm:" in caught.value.hint


def test_without_a_simulator_there_is_an_episode_per_take(runner: RuleRunner) -> None:
    takes = (Take(first=0, last=8, seed=7), Take(first=9, last=20))
    made = runner.run(
        "demonstrate.operate", profile="stub", bundle=task_bundles.lift(), recording=stream(20, takes=takes)
    )
    assert (len(made.items), made.attempts) == (2, 2)


def test_hands_of_another_robot_are_refused_unless_they_are_meant(runner: RuleRunner) -> None:
    bundle = task_bundles.lift()
    place = workplace.of(bundle).model_copy(update={"robot": "another", "joints": ("one",)})
    given = {"profile": "stub", "bundle": bundle, "recording": stream(20, workplace=place)}
    with pytest.raises(RuleError, match="the hands were recorded with another robot") as caught:
        runner.run("demonstrate.operate", **given)
    assert caught.value.facts["recorded"] == f"{bundle.task.name} with another, 1 joints"
    made = runner.run("demonstrate.operate", options={"accept_other": ["robot"]}, **given)
    assert len(made.items) == 1
    assert any("their operator saw something else" in said for said in runner.outcome.warnings)


@pytest.mark.slow
def test_a_recording_without_the_hand_of_the_robot_is_refused(
    runner: RuleRunner, lifting: Callable[[str], TaskBundle]
) -> None:
    """A LEAP Hand follows the right one."""
    with pytest.raises(RuleError, match="no hand in the take moves the robot") as caught:
        followed(runner, lifting("kuka_leap"), stream(20, lost=[(1, 0, 20)]))
    assert caught.value.code == "DXB-B526"
    assert caught.value.facts["right hand"] == "tracked in 0 of 20 messages, clutch closed in 5"
    assert caught.value.facts["the robot follows"] == "right (arm)"


@pytest.mark.slow
def test_a_recording_without_a_hand_that_the_task_names_is_refused(
    runner: RuleRunner, lifting: Callable[[str], TaskBundle]
) -> None:
    with pytest.raises(RuleError, match="limb `left` follows the operator's left hand, which is never seen") as caught:
        followed(runner, lifting("openarm_revo1"), stream(20, lost=[(0, 0, 20)]))
    assert caught.value.code == "DXB-B525"


@pytest.mark.slow
def test_a_take_that_does_nothing_fails_after_its_end_and_all_failing_is_an_error(
    runner: RuleRunner, lifting: Callable[[str], TaskBundle]
) -> None:
    bundle = lifting("kuka_leap")
    still = stream(72)
    still = still.model_copy(
        update={name: np.repeat(getattr(still, name)[:1], 72, axis=0) for name in ("positions", "rotations")}
    )
    made = followed(runner, bundle, still)
    (failure,) = made.failures.values()
    assert not made.items
    assert failure.reason.startswith("not done when the operator stopped: ")
    wanted = still.stamps[-1] + SETTLE_S + bundle.task.hold_s
    assert len(failure.action) / made.rate_hz == pytest.approx(wanted, abs=1.01 / made.rate_hz)
    with pytest.raises(RuleError, match="the operator showed `LiftCan` 0 times of 1") as caught:
        runner.run("demonstrate.operate", backend="hands", bundle=bundle, recording=still)
    assert "attempts: 1" in caught.value.hint


@pytest.mark.slow
def test_the_palm_follows_hands_made_from_a_script_and_the_same_each_time(
    runner: RuleRunner, lifting: Callable[[str], TaskBundle], monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle = lifting("kuka_leap")
    script, hands = hand_tasks.shown(runner, bundle, monkeypatch, open_s=0.5)
    made, again = (followed(runner, bundle, hands) for _ in range(2))
    (shown,) = script.items.values()
    (replayed,) = (*made.items.values(), *made.failures.values())
    (repeated,) = (*again.items.values(), *again.failures.values())
    assert replayed.start.seed == shown.start.seed
    np.testing.assert_array_equal(replayed.start.qpos, shown.start.qpos)
    assert replayed.action.tobytes() == repeated.action.tobytes()
    assert all(replayed.terms[name].tobytes() == repeated.terms[name].tobytes() for name in replayed.terms)
    assert [(each.name, each.frame) for each in replayed.segments] == [("approach", ""), ("manipulate", "can")]
    count = min(len(replayed.hand), len(shown.hand))
    assert count > 40
    off = np.linalg.norm(replayed.hand[:count, 0, :3] - shown.hand[:count, 0, :3], axis=1)
    way = np.linalg.norm(shown.hand[:count, 0, :3] - shown.hand[0, 0, :3], axis=1).max()
    assert way > 0.1
    # Half a message of its motion; both take the same point of the hand for the palm.
    assert off.max() < 0.008
    assert np.median(off) < 0.002
    assert list(made.items) == ["00000"], replayed.reason
    # Half the motion of the arm from the same recording.
    smaller = followed(runner, bundle, hands, hands={"arm_scale": 0.5})
    (half,) = (*smaller.items.values(), *smaller.failures.values())
    count = min(len(half.hand), len(replayed.hand))
    moved, whole = (each.hand[:count, 0, :3] - each.hand[0, 0, :3] for each in (half, replayed))
    np.testing.assert_allclose(moved, whole / 2, atol=1e-4)
