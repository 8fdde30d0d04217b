"""Filters of episodes: each finds the fault that is planted, and passes the same motion without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import ACCELERATION
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses
from dextera_build.sim.experts import filters
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.runtime.environment import Environment
from tests import gantry, task_bundles
from tests.gantry import LIFT, OPEN, SHUT, Move

STRICT = Filters(press_n=2.0, depth_m=0.002, speed=1.1, acceleration=10.0 / ACCELERATION, hold_s=0.5)
BOX, HALF = task_bundles.BOX_M, task_bundles.HALF_M


def run(bundle: TaskBundle, moves: Sequence[Move] = LIFT, limits: Filters = STRICT, **start: np.ndarray) -> Episode:
    """The moves from the photographed start with changed fields."""
    driver = Driver(Environment(bundle))
    begun = driver.environment.start.model_copy(update=start)
    return driver.run(gantry.Moves(driver.environment, moves), begun, origin="operator", filters=limits)


def test_a_clean_lift_passes_all_filters() -> None:
    episode = run(task_bundles.lift())
    assert episode.success, episode.reason


def test_an_unintended_contact_is_found() -> None:
    place = task_bundles.WORLD_FROM_BASE @ [BOX[0] / 2, BOX[1] / 2, 0.16, 1.0]
    wall = f'<geom name="static_wall" type="box" size="0.02 0.02 0.16" pos="{place[0]} {place[1]} {place[2]}"/>'
    episode = run(task_bundles.lift(extra=wall))
    assert episode.reason == "touched `wall` in `approach`"


def test_contact_that_is_too_deep_is_found() -> None:
    press = [*LIFT[:2], Move((0.0, 0.0, -0.08), OPEN, 0.8, "press", "box", True)]
    episode = run(task_bundles.lift(), press, replace(STRICT, press_n=np.inf))
    assert "was pressed too deep into" in episode.reason
    assert "`support`" in episode.reason
    allowed = run(task_bundles.lift(), press, Filters(press_n=np.inf))
    assert "not done" in allowed.reason


@pytest.mark.medium
def test_an_impact_of_what_was_let_go_is_no_press(monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = task_bundles.lift(height_m=0.5)
    drops = []
    for height in (0.11, 0.13, 0.15):
        lifted = replace(LIFT[3], place=(0.0, 0.0, height))
        opened = replace(lifted, fingers=OPEN, seconds=0.4, segment="release")
        drops.append([*LIFT[:3], lifted, opened])
    passed = [run(bundle, moves).reason for moves in drops]
    assert all(reason.startswith("not done") for reason in passed), passed
    monkeypatch.setattr(filters, "IMPACT_S", 0.0)
    # An impact is over within one or two control periods, but each is seen in the substeps.
    assert all("was pressed too deep into" in run(bundle, moves).reason for moves in drops)


def test_what_stays_too_deep_without_a_hand_is_found() -> None:
    walls = ""
    for side in (-1.0, 1.0):
        place = task_bundles.WORLD_FROM_BASE @ [BOX[0] + side * (HALF + 0.016), BOX[1], HALF, 1.0]
        at = " ".join(map(str, place[:3]))
        walls += f'<geom name="static_wall{side:.0f}" type="box" size="0.02 0.04 0.02" pos="{at}"/>'
    episode = run(task_bundles.lift(extra=walls))
    assert "was pressed too deep into" in episode.reason
    assert "`wall" in episode.reason
    assert len(episode.joints) >= 3


def test_a_joint_faster_than_its_limit_is_found() -> None:
    bundle = task_bundles.lift()
    qpos = Environment(bundle).start.qpos.copy()
    # The arm begins 0.3 m from its target, to which it jumps.
    qpos[15] += 0.3
    episode = run(bundle, LIFT, replace(STRICT, lag_m=1.0), qpos=qpos)
    assert episode.reason == "joint `x` moved faster than its limit in `approach`"


def test_a_jerky_command_is_found_and_a_smooth_one_is_not() -> None:
    jump = [replace(LIFT[0], seconds=0.05), *LIFT[1:]]
    lagging = replace(STRICT, lag_m=1.0)
    assert "was accelerated above its limit in `approach`" in run(task_bundles.lift(), jump, lagging).reason
    assert run(task_bundles.lift(), LIFT, lagging).success


def test_a_hand_that_lags_behind_its_command_is_found() -> None:
    far = [Move((0.5, 0.0, 0.1), OPEN, 1.0, "approach")]
    assert (
        run(task_bundles.lift(), far).reason == "limits of the arm's joints or speeds held the hand back in `approach`"
    )


@pytest.mark.parametrize(("hold_s", "reason"), [(0.0, ""), (0.5, "the success did not last")])
def test_a_success_that_does_not_last_is_found(hold_s: float, reason: str) -> None:
    bundle = task_bundles.lift()
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"hold_s": 0.1})})
    # The box is above 100 mm for some tenths of a second.
    drops = [*LIFT, Move((0.0, 0.0, 0.13), OPEN, 0.2, "lift", "box", True)]
    assert run(bundle, drops, replace(STRICT, hold_s=hold_s)).reason == reason


def placing() -> TaskBundle:
    """Put the box down 60 mm to the side."""
    bundle = task_bundles.lift()
    target = bundle.objects["box"].pose.matrix[:3, 3] + bundle.base_pose.matrix[:3, :3] @ [0.0, 0.06, 0.0]
    goal = PlaceGoal(place_m=tuple(target.tolist()), tolerance=Tolerance(position_m=0.02, rotation_rad=0.3))
    return bundle.model_copy(update={"task": bundle.task.model_copy(update={"goal": goal, "timeout_s": 6.0})})


CARRY = (
    Move((0.0, 0.0, 0.06), SHUT, 0.6, "lift", "box", True),
    Move((0.0, 0.06, 0.06), SHUT, 0.6, "carry", "box", True),
    Move((0.0, 0.06, 0.002), SHUT, 0.5, "lower", "box", True),
)
LET_GO = (
    Move((0.0, 0.06, 0.002), OPEN, 0.5, "release", "box", True),
    Move((0.0, 0.06, 0.10), OPEN, 0.5, "retreat", "box", True),
)


@pytest.mark.medium
def test_a_hand_that_does_not_let_go_is_found() -> None:
    kept = run(placing(), [*LIFT[:3], *CARRY])
    assert kept.reason == "not done within 6 s: the object was not released"
    released = run(placing(), [*LIFT[:3], *CARRY, *LET_GO])
    assert released.success, released.reason


def test_inverse_kinematics_without_a_solution_is_a_reason() -> None:
    bundle = task_bundles.lift()
    ctrl = Environment(bundle).start.ctrl.copy()
    # No step within the speed limit leads back into the joint's range.
    ctrl[0] = 0.9
    episode = run(bundle, ctrl=ctrl)
    assert episode.reason == "the inverse kinematics found no solution in `approach`"
    assert len(episode.action)


def test_the_pose_of_a_clean_start_is_that_of_the_photograph() -> None:
    """The first row shows the box where the filters' tests believe it to stand."""
    episode = run(task_bundles.lift())
    assert np.allclose(poses.to_matrix(episode.objects[0, 0])[:3, 3], [*BOX, HALF], atol=2e-3)
