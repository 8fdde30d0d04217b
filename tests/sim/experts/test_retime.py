"""Retiming: a path is slowed to the limits of speed and acceleration, never hastened, and keeps its shape."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import FREE, GaveUp, Part
from dextera_build.sim.experts import synthesis
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import SETTLE_RAD_S, SYNTHESIS
from dextera_build.sim.experts.noise import Noise
from dextera_build.sim.experts.paths import Path
from dextera_build.sim.experts.retime import Limits, accelerations, durations, moments, pose_at, slower
from dextera_build.sim.experts.sources import Source, sources_of
from dextera_build.sim.experts.synthesis import Manner, Synthesis
from dextera_build.sim.runtime.environment import Environment
from tests import factories, gantry, task_bundles

PERIOD = 0.05
LIMITS = Limits(np.array([1.0, 2.0]), np.array([6.0, 6.0]))


def speeds(path: np.ndarray, found: np.ndarray) -> np.ndarray:
    return np.diff(path, axis=0) / (found * PERIOD)[:, None]


@settings(max_examples=20, deadline=None)
@given(st.floats(0.2, 3.0), st.integers(15, 60), st.integers(0, 1000))
def test_no_limit_is_exceeded_and_nothing_is_faster_than_shown(size: float, steps: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 1.0, steps + 1)
    smooth = phase**2 * (3 - 2 * phase)
    path = size * np.stack([smooth, np.sin(3 * rng.random() * smooth)], axis=1)
    found = durations(path, np.ones(steps), LIMITS, np.zeros(2), PERIOD)
    assert (found >= 1.0).all()
    moved = speeds(path, found)
    assert (np.abs(moved) <= LIMITS.speed * (1 + 1e-6)).all()
    spans = PERIOD * np.concatenate([found[:1], (found[1:] + found[:-1]) / 2])
    bends = np.abs(np.diff(np.concatenate([np.zeros((1, 2)), moved]), axis=0)) / spans[:, None]
    assert bends.max() <= 6.0 * 1.02


def test_a_path_within_the_limits_is_left_alone() -> None:
    path = np.linspace(0.0, 0.2, 21)[:, None] ** 2 * np.ones(2)
    assert np.array_equal(durations(path, np.ones(20), LIMITS, np.zeros(2), PERIOD), np.ones(20))
    assert np.allclose(moments(np.ones(5)), [1, 2, 3, 4, 5])


def test_moments_are_whole_periods_that_end_at_the_end() -> None:
    found = moments(np.array([1.0, 2.5, 1.0]))
    assert len(found) == 5
    assert found[-1] == 3.0
    assert (np.diff(found) > 0).all()
    assert np.diff(found).max() <= 1.0 + 1e-9


def test_poses_between_are_smooth_and_exact_at_the_steps() -> None:
    path = np.array([factories.pose(0.02 * row**2, 0.05 * row, 0.1, yaw=0.03 * row**2) for row in range(8)])
    assert np.allclose(pose_at(path, 3.0), path[3])
    assert np.allclose(pose_at(path, 7.0), path[7])
    fine = [pose_at(path, place) for place in np.arange(1.0, 6.0, 0.01)]
    moves = np.diff([pose[:3, 3] for pose in fine], axis=0)
    turns = [transforms.angle(one[:3, :3].T @ other[:3, :3]) for one, other in pairwise(fine)]
    # A polygon would change its speed at every step at once: here by 40 mm and 0.06 rad.
    assert np.abs(np.diff(moves, axis=0)).max() < 0.1 * 0.04
    assert np.abs(np.diff(turns)).max() < 0.1 * 0.06


def test_what_is_sent_is_measured_and_slowed_near_where_it_is_too_much() -> None:
    sent = np.array([[0.0], [0.0], [0.1], [0.2], [0.2]])
    assert accelerations(sent, np.zeros(1), 0.1)[:, 0] == pytest.approx([0.0, 10.0, 0.0, 10.0])
    longer = slower(np.ones(10), np.array([4.0, 5.0]), np.array([1.0, 1.3]))
    assert longer[1:9] == pytest.approx(1.3)
    assert longer[0] == longer[9] == 1.0


def slowed(joint: str, acceleration: float) -> TaskBundle:
    """The gantry's task, in which one joint states its own acceleration."""
    bundle = task_bundles.lift(reset=gantry.RESET)
    joints = tuple(
        each.model_copy(update={"acceleration": acceleration}) if each.name == joint else each
        for each in bundle.robot.joints
    )
    task = bundle.task.model_copy(update={"timeout_s": 20.0})
    return bundle.model_copy(update={"robot": bundle.robot.model_copy(update={"joints": joints}), "task": task})


@pytest.mark.medium
def test_each_joint_is_slowed_to_the_acceleration_that_its_robot_states() -> None:
    most, sources = 0.6, gantry.demonstrations(task_bundles.lift(reset=gantry.RESET), 2)
    found = {}
    for name, bundle in (("z", slowed("z", most)), ("all", task_bundles.lift(reset=gantry.RESET))):
        driver = Driver(Environment(bundle), SETTLE_RAD_S)
        manner = Manner(noise=Noise(), filters=SYNTHESIS)
        made = synthesis.synthesise(driver, sources, driver.environment.draw(3), 3, manner)
        assert made.success, made.reason
        sent = np.vstack([made.action[:1], made.action]).astype(np.float64)
        found[name] = accelerations(sent, np.zeros(sent.shape[1]), driver.environment.period_s).max(axis=0)
    # The third joint of the gantry is its height.
    assert found["z"][2] <= most + 1e-3
    assert found["all"][2] > 1.0


@pytest.fixture(scope="module")
def driver() -> Driver:
    return Driver(Environment(task_bundles.lift(reset=gantry.RESET)), 0.08)


def detour(operator: Synthesis, contact: bool) -> Path:
    """Ten steps over a detour of 50 mm to 100 mm beside the hand, then three towards the object."""
    limb, here = next(iter(operator._palms.items()))
    palms = np.repeat(here[None, None], 14, axis=0)
    palms[:, 0, 0, 3] += 0.1 * np.minimum(np.arange(14) / 10, 1.0)
    palms[:, 0, 1, 3] += 0.05 * np.sin(np.pi * np.minimum(np.arange(14) / 10, 1.0))
    palms[10:, 0, 2, 3] -= 0.01 * np.arange(4)
    parts = [Part("approach", FREE, contact)] * 10 + [Part("reach", "box")] * 3
    fingers = np.repeat(operator._fingers[limb][None], 14, axis=0)
    return Path((limb,), palms, (fingers,), np.ones(13), [{limb: part} for part in parts])


def test_free_motion_is_made_straight_in_the_joints_and_the_rest_is_kept(driver: Driver) -> None:
    sources = sources_of(gantry.demonstrations(driver.environment.bundle, 1))
    driver.environment.begin(driver.environment.draw(5))
    driver.control.begin(driver.environment.previous_action)
    operator = Synthesis(sources, driver.environment, driver.control, Manner(), 0)
    operator._from_targets()
    path = detour(operator, contact=False)
    assert path.free == 10
    found = operator._in_joints(path)
    # The gantry's joints are the axes of its palm.
    assert np.abs(found.palms[:10, 0, 1, 3] - path.palms[0, 0, 1, 3]).max() < 2e-3
    assert (np.diff(found.palms[:11, 0, 0, 3]) > 0).all()
    np.testing.assert_allclose(found.palms[0], path.palms[0], atol=1e-6)
    np.testing.assert_array_equal(found.palms[10:], path.palms[10:])
    with pytest.raises(GaveUp, match="no slower motion"):
        operator._in_joints(replace(path, labels=[{"arm": Part("reach", "box")}] * 13))


def test_what_one_hand_holds_moves_freely_and_what_two_hands_hold_binds_them(driver: Driver) -> None:
    sources = sources_of(gantry.demonstrations(driver.environment.bundle, 1))
    operator = Synthesis(sources, driver.environment, driver.control, Manner(), 0)
    carried = detour(operator, contact=True)
    assert carried.free == 10
    both = [{**parts, "other": parts["arm"]} for parts in carried.labels]
    assert replace(carried, limbs=("arm", "other"), labels=both).free == 0


@pytest.mark.medium
def test_fingers_are_slow_enough_to_push_no_other_finger_faster_than_it_can(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = driver.environment
    sources = gantry.demonstrations(environment.bundle, 2)
    hand = [number for number, joint in enumerate(environment.bundle.robot.joints) if joint.group == "hand"]
    limits = np.array([environment.bundle.robot.joints[number].velocity for number in hand])

    def fastest() -> float:
        episode = synthesis.synthesise(driver, sources, environment.draw(5), 5, Manner())
        assert "grasp" in {segment.name for segment in episode.segments}
        return float((np.abs(np.diff(episode.action[:, hand], axis=0)) * 20.0 / limits).max())

    monkeypatch.setattr(synthesis, "SPARE_FINGERS", 0.05)
    assert fastest() <= 0.05 + 1e-6
    monkeypatch.setattr(synthesis, "SPARE_FINGERS", 1.0)
    assert fastest() > 0.05


@pytest.mark.medium
def test_fingers_that_nobody_overpowered_are_softened_if_asked_for(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment, seen = driver.environment, list[str]()
    sources = gantry.demonstrations(environment.bundle, 2)

    def softened(source: Source, *_: object) -> Source:
        seen.append(source.name)
        return source

    monkeypatch.setattr(synthesis, "softened", softened)
    synthesis.synthesise(driver, sources, environment.draw(5), 5, Manner(filters=SYNTHESIS))
    assert not seen
    synthesis.synthesise(driver, sources, environment.draw(5), 5, Manner(filters=SYNTHESIS, soften=True))
    assert sorted(seen) == sorted(sources.items)


@pytest.mark.medium
def test_another_grasp_is_used_only_where_the_common_one_is_out_of_reach(driver: Driver) -> None:
    environment = driver.environment
    shown = gantry.demonstrations(environment.bundle, 3)
    names = sorted(shown.items)

    def moved(by: np.ndarray) -> dict[str, Episode]:
        """Two of three demonstrations with the palm elsewhere at the object."""
        return {
            name: each if name == names[2] else each.model_copy(update={"hand": each.hand + by.astype(np.float32)})
            for name, each in shown.items.items()
        }

    there = np.zeros((1, 1, 7))
    there[..., 2] = 0.05
    near = shown.model_copy(update={"items": moved(there)})
    assert [source.grasp for source in sources_of(near)] == [0, 0, 1]
    start = environment.draw(5)
    assert names[2] not in synthesis.synthesise(driver, near, start, 5, Manner()).sources
    far = shown.model_copy(update={"items": moved(10.0 * there)})
    episode = synthesis.synthesise(driver, far, start, 5, Manner())
    assert episode.success, episode.reason
    assert episode.sources == (names[2],)
    lost = far.model_copy(update={"items": {name: far.items[name] for name in names[:2]}})
    assert not synthesis.synthesise(driver, lost, start, 5, Manner()).success
