"""Fingers that follow an operator's, on the hands of the shipped robots."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_pinch import pinching
from dextera_build.sim.retarget.fingers import Fingers
from dextera_build.sim.retarget.hand_model import HandModel
from dextera_build.sim.retarget.matching import Matched, matched
from dextera_build.sim.retarget.options import Retargeting
from tests.hand_motions import motion
from tests.robots.robot_recipes import at, compiled, touching

UNREACHED = {"pinky"}
"""Fingers that the thumb of a Revo 1 does not reach."""


def shown(own: Matched, points: np.ndarray, **options: float) -> np.ndarray:
    """The posture (H,) after a hand was held still for a while."""
    follower = Fingers(own, hands.finger_lengths(points), Retargeting(**options))
    *_, last = (follower.next(points, 1 / 72) for _ in range(40))
    return last


def posed(own: Matched, angles: np.ndarray, length_m: float = 0.19) -> np.ndarray:
    points, _ = human_hand.Hand(length_m, 0.45 * length_m).joints(angles, own.side)
    return points


def whole(robot: RobotModel, own: Matched, posture: np.ndarray) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The whole robot with the hand in a posture."""
    model = compiled(robot)
    joints = dict(zip(own.hand.joints, posture.tolist(), strict=True))
    return model, at(model, robot.followed({**robot.home, **joints}))


def surface_gap(model: mujoco.MjModel, data: mujoco.MjData, sites: tuple[str, str]) -> float:
    """Smallest distance of the collision geometry of the links that two fingertips are on [m]."""
    links = [
        [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.site(s).bodyid[0] and model.geom_contype[g]]
        for s in sites
    ]
    return min(mujoco.mj_geomDistance(model, data, one, other, 1.0, None) for one in links[0] for other in links[1])


@pytest.mark.parametrize("finger", hands.FINGERS[1:])
def test_a_pinch_of_ten_millimetres_closes_the_surfaces_of_the_tips(hand, finger: str) -> None:
    robot, limb = hand
    own = matched(robot, limb)
    names = [hands.FINGERS[each] for each in own.fingers]
    if finger not in names:
        pytest.skip("a LEAP Hand has four fingers")
    posture = shown(own, posed(own, pinching(finger, 0.010)))
    model, data = whole(robot, own, posture)
    prefix = "" if limb == "arm" else f"{limb}_"
    roles = [f"{prefix}tip_thumb", f"{prefix}tip_{'little' if finger == 'pinky' else finger}"]
    gap = surface_gap(model, data, (robot.frames[roles[0]], robot.frames[roles[1]]))
    if limb != "arm" and finger in UNREACHED:
        assert 0.005 < gap < 0.040
    else:
        assert -0.001 < gap < 0.005
    own.hand.at(posture)
    assert own.hand.gap(0, names.index(finger)) == pytest.approx(gap, abs=1e-6)


@pytest.mark.parametrize("length_m", [0.17, 0.19, 0.21])
@pytest.mark.parametrize("spread_deg", [(6, 0, -5, -10), (12, 4, -8, -18), (-2, 0, 2, 3)])
def test_an_open_hand_touches_nothing(hand, length_m: float, spread_deg: tuple[float, ...]) -> None:
    """Also with the fingers side by side."""
    robot, limb = hand
    own = matched(robot, limb)
    angles = human_hand.open_angles()
    angles[1:, 0] = np.deg2rad(spread_deg)
    model, data = whole(robot, own, shown(own, posed(own, angles, length_m)))
    assert not touching(model, data)


def test_limits_hold_and_followers_keep_their_ratio(hand) -> None:
    robot, limb = hand
    own = matched(robot, limb)
    stamps, points, _ = motion(30.0, own.side, noise_m=2e-3, seed=1)
    follower = Fingers(own, hands.finger_lengths(points[0]), Retargeting(scale=0.5))  # beyond the limits in a fist
    limits = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    lower, upper = np.array([limits[name] for name in own.hand.joints]).T
    led = {each.name: each for each in robot.followers if each.leader in own.hand.joints}
    assert len(led) == sum(each.name.startswith(f"{limb}_") for each in robot.followers)
    at_limit = 0
    for hand_points in points[::3]:
        posture = follower.next(hand_points, 3 * float(stamps[1]))
        assert (posture >= lower - 1e-12).all()
        assert (posture <= upper + 1e-12).all()
        at_limit += int((np.minimum(upper - posture, posture - lower) < 1e-4).any())
        own.hand.at(posture)
        for name, each in led.items():
            leader = posture[own.hand.joints.index(each.leader)]
            assert own.hand.data.joint(name).qpos[0] == pytest.approx(each.ratio * leader + each.offset)
    assert at_limit > 10


@pytest.mark.medium
def test_a_robot_that_is_the_operator_gets_its_own_tips_back(hand) -> None:
    """Tips of postures of the robot itself, as the tips of an operator of its proportions."""
    robot, limb = hand
    own = matched(robot, limb)
    random, missed = np.random.default_rng(4), []
    # Fingers side by side: their tips would be pushed apart.
    span = np.where([name.endswith("f_rot") for name in own.hand.joints], 0.0, own.hand.upper - own.hand.lower)
    for _ in range(40):
        bend = random.uniform(0.05, 0.45, len(own.straight))
        posture = np.clip(own.straight + bend * span, own.hand.lower, own.hand.upper)
        seen = own.hand.at(posture)
        apart = np.linalg.norm(seen.tips[1:] - seen.tips[0], axis=1).min()
        if len(seen.close) or apart < Retargeting.leave_m:
            continue
        points = posed(own, human_hand.open_angles())
        follower = Fingers(own, hands.finger_lengths(points), Retargeting(scale=1.0, low_pass_hz=0.0))
        points[follower.beside.tips] = follower.beside.human_tips(seen.tips, points)
        found = [follower.next(points, 1 / 72) for _ in range(12)][-1]
        missed.append(np.linalg.norm(own.hand.at(found).tips - seen.tips, axis=1).max())
    assert len(missed) >= 6
    assert max(missed) < 1.5e-3


def test_derivatives_are_those_of_differences(hand) -> None:
    robot, limb = hand
    own = HandModel(robot, limb, robot.limbs[limb].tips)
    random = np.random.default_rng(0)
    for _ in range(4):
        posture = random.uniform(own.lower, own.upper)
        steps = 1e-6 * np.eye(len(posture))
        pairs = [(own.at(posture + step), own.at(posture - step)) for step in steps]
        own.at(posture)
        tips, centres, _ = own.moving()
        assert tips == pytest.approx(np.stack([(a.tips - b.tips) / 2e-6 for a, b in pairs], -1), abs=1e-6)
        assert centres == pytest.approx(np.stack([(a.centres - b.centres) / 2e-6 for a, b in pairs], -1), abs=1e-6)


def test_close_parts_part_along_their_derivative(leap: RobotModel) -> None:
    own = HandModel(leap, "arm", leap.limbs["arm"].tips)
    random, checked = np.random.default_rng(2), 0
    while checked < 5:
        posture = random.uniform(own.lower, own.upper)
        seen = own.at(posture)
        shallow = (seen.close > -0.001) & (seen.close < 0.001)
        if len(seen.close) != 1 or not shallow.all():
            continue
        _, _, close = own.moving()
        if np.linalg.norm(close[0]) < 1e-3:
            continue
        step = 1e-5 * close[0] / np.linalg.norm(close[0])
        gained = own.at(posture + step).close[0] - own.at(posture - step).close[0]
        assert gained == pytest.approx(2e-5 * np.linalg.norm(close[0]), rel=0.05)
        checked += 1


@pytest.mark.medium
def test_noise_moves_joints_less_with_a_lower_cut_off(leap: RobotModel) -> None:
    own = matched(leap, "arm")
    random = np.random.default_rng(0)
    points = posed(own, human_hand.open_angles()) + random.normal(0, 5e-4, (100, 25, 3))
    spread = []
    for cut_off in (0.0, 10.0, 3.0):
        follower = Fingers(own, hands.finger_lengths(points[0]), Retargeting(low_pass_hz=cut_off))
        spread.append(np.std(np.array([follower.next(each, 1 / 72) for each in points])[30:], axis=0).mean())
    assert spread[0] > 1.3 * spread[1] > 2 * spread[2] > 0
