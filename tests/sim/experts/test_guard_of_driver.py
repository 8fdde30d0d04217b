"""A driver with a guard: every target passes it, the label is what passed, and what it stops is a failed episode."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.runtime.environment import Environment
from tests import gantry, task_bundles
from tests.gantry import LIFT

LOOSE = Filters(lag_m=1.0)


def run(limits: Limits | None, filters: Filters = LOOSE) -> Episode:
    """The box is lifted."""
    driver = Driver(Environment(task_bundles.lift()), limits=limits)
    operator = gantry.Moves(driver.environment, LIFT)
    return driver.run(operator, driver.environment.start, origin="operator", filters=filters)


def test_limits_of_the_joints_alone_change_nothing() -> None:
    free, guarded = run(None), run(Limits())
    assert free.success
    assert guarded.success
    np.testing.assert_allclose(guarded.action, free.action, atol=1e-6)


@pytest.mark.medium
def test_a_slower_guard_slows_the_robot_and_the_label_is_what_passed() -> None:
    bundle, part = task_bundles.lift(), 0.2
    most = part * np.array([joint.velocity for joint in bundle.robot.joints]) / bundle.task.control_hz
    # A step is rounded to single precision at both of its ends.
    assert (np.abs(np.diff(run(None).action, axis=0)) > most + 1e-6).any()
    slowed = run(Limits(speed=part))
    assert (np.abs(np.diff(slowed.action, axis=0)) <= most + 1e-6).all()
    np.testing.assert_array_equal(slowed.action, slowed.executed)


def test_a_hand_that_the_guard_holds_back_too_far_ends_the_episode() -> None:
    held = run(Limits(speed=0.05), Filters(lag_m=0.02))
    assert held.reason.endswith("held the hand back in `approach`")


def test_a_palm_that_would_leave_the_workspace_stops_the_robot() -> None:
    highest = task_bundles.HALF_M + 0.12
    stopped = run(Limits(workspace_m=((-9.0, -9.0, -9.0), (9.0, 9.0, highest))))
    assert stopped.reason.startswith("the guard stopped the robot: the palm of `")
    assert "would leave the workspace: z" in stopped.reason
    assert not stopped.success


@pytest.mark.parametrize(("force_n", "stops"), [(1e-3, True), (1e3, False)])
def test_a_fingertip_that_presses_too_hard_stops_the_robot(force_n: float, stops: bool) -> None:
    found = run(Limits(force_n=force_n))
    assert found.success != stops
    if stops:
        assert "presses with more than 0.001 N" in found.reason
        assert found.segments[-1].name == "grasp"


@pytest.mark.medium
def test_the_same_guard_gives_the_same_bytes() -> None:
    one, other = (run(Limits(speed=0.3, force_n=50.0)) for _ in range(2))
    assert one.action.tobytes() == other.action.tobytes()
    assert one.executed.tobytes() == other.executed.tobytes()
