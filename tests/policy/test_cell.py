"""The guard lets nothing pass that a cell's limits forbid, and stays shut."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.policy.cell import Guard, Stopped
from tests import task_bundles

ROBOT = task_bundles.robot()
HOME = np.array([joint.home for joint in ROBOT.joints])
RATE = 20.0
NO_FORCE = np.zeros((2, 3))


def guard(**limits: object) -> Guard:
    """The gantry's, whose palm is where its first three slides are."""
    made = Guard(Limits.model_validate(limits), ROBOT, RATE, lambda joints: joints[None, :3])
    made.begin(HOME)
    return made


def test_of_two_limits_the_stricter_is_kept() -> None:
    one = Limits(speed=0.5, silence_s=0.5, workspace_m=((-1, -1, 0), (1, 1, 1)))
    other = Limits(speed=0.2, force_n=9.0, workspace_m=((-2, 0, 0), (0.5, 1, 2)))
    both = Limits(speed=0.2, force_n=9.0, silence_s=0.5, workspace_m=((-1, 0, 0), (0.5, 1, 1)))
    assert one.stricter(other) == other.stricter(one) == both
    assert one.stricter(Limits()) == one


@pytest.mark.parametrize("speed", [1.0, 0.25])
def test_targets_are_cut_to_range_and_speed(speed):
    made = guard(speed=speed)
    random = np.random.default_rng(0)
    before = HOME
    for _ in range(200):
        sent = made.passed(before + random.normal(0, 0.5, 5), NO_FORCE, 0.0)
        for joint, old, new in zip(ROBOT.joints, before, sent, strict=True):
            assert joint.lower <= new <= joint.upper
            assert abs(new - old) <= speed * joint.velocity / RATE + 1e-12
        before = sent
    near = before + 1e-4 * np.sign(HOME - before)
    assert made.passed(near, NO_FORCE, 0.0) == pytest.approx(np.clip(near, -1, 1), abs=2e-4)


@pytest.mark.parametrize(
    ("limits", "targets", "forces", "silent_s", "why"),
    [
        ({}, [np.nan, 0, 0, 0, 0], NO_FORCE, 0.0, "the target of x is not a finite number"),
        ({}, [0.0, 0.0], NO_FORCE, 0.0, "2 targets for 5 joints"),
        ({"silence_s": 0.5}, HOME, NO_FORCE, 0.6, "no frame arrived for more than 0.5 s"),
        ({"force_n": 5}, HOME, [[0, 3, 0], [0, -3, 5]], 0.0, "`tip_right` presses with more than 5 N"),
        (
            {"workspace_m": ((-1, -1, 0.0), (1, 1, 1))},
            [0, 0, -0.1, 0.05, 0.05],
            NO_FORCE,
            0.0,
            "the palm of `arm` would leave the workspace: z is not within 0 to 1 m",
        ),
    ],
)
def test_what_is_forbidden_stops_the_robot_until_it_begins_anew(limits, targets, forces, silent_s, why):
    made = guard(**limits)
    assert made.passed(HOME, NO_FORCE, 0.0) == pytest.approx(HOME)
    with pytest.raises(Stopped) as caught:
        made.passed(np.array(targets), np.array(forces, float), silent_s)
    assert caught.value.message == f"the guard stopped the robot: {why}"
    with pytest.raises(Stopped, match="stopped the robot"):
        made.passed(HOME, NO_FORCE, 0.0)
    made.begin(HOME)
    assert made.passed(HOME, NO_FORCE, 0.0) == pytest.approx(HOME)


@pytest.mark.parametrize(("beyond", "wanted"), [(0.02, 0.0), (0.02, 0.7), (-0.02, 0.0)])
def test_a_joint_beyond_its_limit_returns_at_its_speed_and_goes_no_farther(beyond, wanted):
    made, joint = guard(speed=0.1), ROBOT.joints[0]
    before = HOME.copy()
    before[0] = (joint.upper if beyond > 0 else joint.lower) + beyond
    made.begin(before)
    step, targets = 0.1 * joint.velocity / RATE, HOME.copy()
    targets[0] = wanted
    for _ in range(20):
        sent = made.passed(targets, NO_FORCE, 0.0)
        assert abs(sent[0] - before[0]) <= step + 1e-12
        assert abs(sent[0]) <= abs(before[0])
        before = sent
