"""reference.hands: hands that a program makes from a robot's motion have bones, a rate, a tremor, losses and takes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import LOST, PREDICTED, TRACKED, HandStream
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Start
from dextera_build.errors import RuleError
from dextera_build.formats import mcap
from dextera_build.geometry import hands, human_hand, lie, quaternions
from dextera_build.policy.layout import embodiment
from dextera_build.sim.retarget.matching import matched
from dextera_build.testing import RuleRunner
from rules.reference.operator import fitted, smooth, unsteady
from rules.reference.operator.smooth import Motion
from rules.reference.operator.unsteady import UnsteadyOptions
from tests.robots.robot_recipes import built

RATE_HZ, STEPS = 20.0, 40
STEADY = dict.fromkeys(("tremor_m", "tremor_deg", "jitter_m", "jitter_deg", "drift_m", "drift_deg", "clock_s"), 0.0)
STEADY |= {"losses_per_min": 0.0}
HAND = human_hand.Hand()


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("rules"))


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], RobotModel]:
    made: dict[str, RobotModel] = {}

    def get(name: str) -> RobotModel:
        if name not in made:
            made[name] = built(name, tmp_path_factory.mktemp(name))
        return made[name]

    return get


def shown(robot: RobotModel, count: int = 1, grip: str = "pinch") -> Episodes:
    """Palms move along an arc and turn while every hand closes; arithmetic, no simulator ran."""
    share = np.linspace(0, 1, STEPS)
    action = np.array([[joint.home for joint in robot.joints]] * STEPS)
    for limb in robot.limbs.values():
        opened, closed = limb.grips[grip].open, limb.grips[grip].closed
        for number, joint in enumerate(robot.joints):
            if joint.name in opened:
                action[:, number] = opened[joint.name] + share * (closed[joint.name] - opened[joint.name])
    palms = np.zeros((STEPS, len(robot.limb_names), 7))
    for row, part in enumerate(share):
        for limb in range(len(robot.limb_names)):
            place = [0.5 + 0.1 * np.sin(part), 0.2 - 0.4 * limb, 0.3 + 0.2 * part]
            palms[row, limb] = [*place, *quaternions.from_matrix(lie.rotation(np.array([0.1, 0.4 * part, 0.2])))]
    names = tuple(joint.name for joint in robot.joints)
    start = Start(seed=5, qpos=np.zeros(1), ctrl=np.zeros(len(names)), mass_scale={}, friction={}, gain_scale=1.0)
    items = {
        f"{number:05d}": Episode(
            start=start.model_copy(update={"seed": 5 + number}),
            origin="operator",
            success=True,
            reason="",
            action=action.astype(np.float32),
            executed=action.astype(np.float32),
            hand=palms.astype(np.float32),
            goal=np.zeros(0, np.float32),
            terms={"joints": action.astype(np.float32)},
        )
        for number in range(count)
    }
    fields: dict[str, Any] = {"object_names": (), "displacement_names": (), "tip_names": robot.tips}
    return Episodes(
        items=items,
        failures={},
        attempts=count,
        task="Close",
        embodiment=embodiment(robot),
        rate_hz=RATE_HZ,
        joint_names=names,
        limb_names=robot.limb_names,
        **fields,
    )


def made(runner: RuleRunner, robot: RobotModel, count: int = 1, **options: Any) -> HandStream:
    found: HandStream = runner.run("reference.hands", robot=robot, episodes=shown(robot, count), options=options)
    return found


def test_fitted_angles_reach_the_tips_of_a_posture_within_the_limits() -> None:
    random = np.random.default_rng(0)
    low, high = np.deg2rad(human_hand.LIMITS_DEG[..., 0]), np.deg2rad(human_hand.LIMITS_DEG[..., 1])
    posed = low + (0.3 + 0.4 * random.random((30, 5, 4))) * (high - low)
    posed[:, 1:, 3] = human_hand.COUPLED * posed[:, 1:, 2]
    wanted = fitted.tips(HAND, posed)
    found = fitted.angles(HAND, wanted, (0, 1, 2, 3, 4))
    assert np.linalg.norm(fitted.tips(HAND, found) - wanted, axis=-1).max() < 0.002
    assert (found >= low - 1e-9).all()
    assert (found <= high + 1e-9).all()


def test_fingers_without_a_target_bend_as_the_one_before() -> None:
    wanted = fitted.tips(HAND, human_hand.open_angles()[None] * 3)[:, [0, 1, 2, 3]]
    found = fitted.angles(HAND, wanted, (0, 1, 2, 3))
    np.testing.assert_array_equal(found[:, 4], found[:, 3])


def test_a_motion_at_another_rate_passes_through_its_moments() -> None:
    times = np.arange(20) / 20
    turns = [quaternions.from_matrix(lie.rotation(np.array([0.0, 3 * time, 0.0]))) for time in times]
    wrist = np.hstack([np.stack([times, np.sin(4 * times), times**2], axis=1), turns])
    found = smooth.resampled(Motion(wrist, np.zeros((20, 5, 4))), 20.0, 80.0)
    assert len(found.wrist) == 19 * 4 + 1
    np.testing.assert_allclose(found.wrist[::4, :3], wrist[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.wrist[:, 3:], axis=1), 1)
    assert np.abs(found.wrist[:, 1] - np.sin(np.arange(77) / 20))[4:-4].max() < 2e-4


def test_a_way_begins_and_ends_at_rest() -> None:
    begin = Motion(np.array([[0.0, 0, 0, 1, 0, 0, 0]]), np.zeros((1, 5, 4)))
    end = Motion(np.array([[1.0, 0, 0, -1, 0, 0, 0]]), np.ones((1, 5, 4)))
    found = smooth.way(begin, end, 100)
    speed = np.diff(found.wrist[:, 0])
    assert found.wrist[0, 0] == 0
    assert speed[0] < 0.001 * speed.max()
    np.testing.assert_allclose(np.abs(found.wrist[:, 3]), 1)


def test_tremor_lies_in_its_band_and_has_its_size() -> None:
    options = UnsteadyOptions(**STEADY | {"tremor_m": 0.0002})
    found, _ = unsteady.errors(options, 72.0, 720, (3, 1), np.random.default_rng(0))
    assert found.std() == pytest.approx(0.0002)
    power = np.abs(np.fft.rfft(found, axis=0)) ** 2
    frequencies = np.fft.rfftfreq(720, 1 / 72)
    assert power[(frequencies >= 8) & (frequencies <= 12)].sum() > 0.999 * power.sum()


def test_losses_are_as_frequent_and_as_long_as_stated() -> None:
    options = UnsteadyOptions(losses_per_min=6.0, loss_s=0.2)
    found = unsteady.losses(options, 72.0, 72 * 3600, np.random.default_rng(0))
    begins = int((found == 1).sum())
    assert begins == pytest.approx(360, rel=0.15)
    assert (found > 0).sum() / begins / 72 == pytest.approx(0.2, rel=0.15)


def test_the_clock_is_uneven_and_increases() -> None:
    stamps = unsteady.clock(UnsteadyOptions(clock_s=0.01), 72.0, 1000, np.random.default_rng(0))
    assert (np.diff(stamps) > 0).all()
    assert np.diff(stamps).std() > 0.001


@pytest.mark.medium
@pytest.mark.parametrize("name", ["kuka_leap", "openarm_revo1"])
def test_hands_follow_the_palms_and_close_with_the_robot(
    name: str, runner: RuleRunner, robots: Callable[[str], RobotModel]
) -> None:
    robot = robots(name)
    found = made(runner, robot, rate_hz=20.0, open_s=1.0, way_s=1.0, unsteady=STEADY)
    sides = [0, 1] if len(robot.limbs) == 2 else [1]
    assert [side for side in (0, 1) if (found.tracking[:, side] == TRACKED).all()] == sides
    assert (found.frame, found.synthetic) == ("base", True)
    (take,) = found.takes
    assert (take.last - take.first, take.seed) == (STEPS, 5)
    np.testing.assert_array_equal(found.clutch[:, 1], np.arange(len(found.stamps)) >= take.first)
    episode = shown(robot).items["00000"]
    for row, limb in enumerate(robot.limb_names):
        side = hands.SIDES.index(limb) if limb in hands.SIDES else 1
        points = found.positions[:, side].astype(np.float64)
        # The point of the palm that retargeting takes for the robot's goes where the robot's palm is, with its axes.
        beside = matched(robot, limb).beside(hands.finger_lengths(points[take.first]))
        assert beside.side == hands.SIDES[side]
        for moment, pose in zip(points[take.first :], episode.hand[:, row], strict=True):
            np.testing.assert_allclose(beside.origin(moment), pose[:3], atol=1e-5)
            np.testing.assert_allclose(beside.axes(moment), quaternions.to_matrix(pose[3:]), atol=1e-4)
        # It is a hand of its side, whose bones keep their lengths, and which closes as the robot's does.
        assert hands.curl(points).mean() * (1 if side else -1) > 0.03 * HAND.length_m
        assert np.ptp(hands.bone_lengths(points), axis=0).max() < 1e-5
        assert hands.hand_size(points).mean() == pytest.approx(HAND.length_m, rel=0.01)
        pinched = hands.pinch_distance(points)[[take.first, -1]]
        assert pinched[1] < 0.6 * pinched[0]


def test_a_hand_of_another_size_is_scaled(runner: RuleRunner, robots: Callable[[str], RobotModel]) -> None:
    small, large = (
        made(runner, robots("kuka_leap"), hand_length_m=size, hand_breadth_m=0.45 * size, unsteady=STEADY, rate_hz=20.0)
        for size in (0.15, 0.2)
    )
    ratio = hands.bone_lengths(large.positions[:, 1]) / hands.bone_lengths(small.positions[:, 1])
    np.testing.assert_allclose(ratio, 0.2 / 0.15, rtol=1e-3)
    apart = [hands.pinch_distance(each.positions[-1, 1]) for each in (large, small)]
    assert apart[0] / apart[1] == pytest.approx(0.2 / 0.15, rel=0.1)


def test_takes_follow_one_another_without_jumps(runner: RuleRunner, robots: Callable[[str], RobotModel]) -> None:
    found = made(runner, robots("kuka_leap"), count=3, takes=3)
    assert [take.seed for take in found.takes] == [5, 6, 7]
    assert found.rate_hz == pytest.approx(72, rel=0.05)
    for take in found.takes:
        before = np.arange(take.first - 216, take.first - 72)
        assert not found.clutch[before].any()
        assert np.nanstd(hands.finger_lengths(found.positions[before, 1])[:, 1]) < 1e-5
    seen = np.flatnonzero(found.tracking[:, 1] == TRACKED)
    pairs = seen[1:][np.diff(seen) == 1]
    way = np.linalg.norm(found.positions[pairs, 1, 0] - found.positions[pairs - 1, 1, 0], axis=1)
    assert way.max() < 0.03


@pytest.mark.medium
def test_noise_keeps_bones_and_repeats_with_its_seed(
    runner: RuleRunner, robots: Callable[[str], RobotModel], tmp_path: Path
) -> None:
    first, again, other = (
        made(runner, robots("kuka_leap"), seed=seed, unsteady={"losses_per_min": 60.0}) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first.positions, again.positions)
    assert not np.array_equal(first.positions, other.positions, equal_nan=True)
    assert {int(code) for code in first.tracking[:, 1]} == {LOST, PREDICTED, TRACKED}
    assert np.isnan(first.positions[first.tracking == LOST]).all()
    points = first.positions[first.tracking[:, 1] > LOST, 1]
    assert np.ptp(hands.bone_lengths(points), axis=0).max() < 1e-5
    # What a program made passes the checks of what a headset recorded, and says what it is.
    recording = mcap.load(first.save(tmp_path / "made.mcap")[0])
    captured = runner.run("capture.hands", stream=recording, options={"sides": "right"})
    np.testing.assert_array_equal(captured.positions, first.positions)
    assert captured.takes == first.takes
    assert captured.synthetic
    assert "no person and no headset" in " ".join(captured.facts())
    assert "no person and no headset" in runner.outcome.line


def test_without_a_simulator_the_hand_stays_open(runner: RuleRunner, robots: Callable[[str], RobotModel]) -> None:
    robot = robots("kuka_leap")
    found = runner.run("reference.hands", robot=robot, episodes=shown(robot), profile="stub")
    assert len(found.takes) == 1
    assert hands.pinch_distance(found.positions[found.tracking[:, 1] > LOST, 1]).min() > 0.02


def test_episodes_of_another_robot_and_no_episode_are_refused(
    runner: RuleRunner, robots: Callable[[str], RobotModel]
) -> None:
    leap, revo = robots("kuka_leap"), robots("openarm_revo1")
    with pytest.raises(RuleError, match="the episodes are of another robot") as caught:
        runner.run("reference.hands", robot=leap, episodes=shown(revo))
    assert caught.value.hint == "give the robot of the task"
    with pytest.raises(RuleError, match="no episode succeeded"):
        runner.run("reference.hands", robot=leap, episodes=shown(leap, count=0))


def test_a_limb_without_a_hand_is_refused(runner: RuleRunner, robots: Callable[[str], RobotModel]) -> None:
    robot = robots("kuka_leap")
    limbs = {name: limb.model_copy(update={"tips": limb.tips[:2]}) for name, limb in robot.limbs.items()}
    with pytest.raises(RuleError, match="no hand that an operator's hand can move"):
        runner.run("reference.hands", robot=robot.model_copy(update={"limbs": limbs}), episodes=shown(robot))
