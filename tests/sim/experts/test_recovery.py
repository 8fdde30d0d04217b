"""Perturb and recover: the robot leaves its path, the label follows, and both come back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import ACCELERATION
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.sim.experts import recovery, synthesis
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.experts.noise import Noise
from dextera_build.sim.experts.recovery import FOLLOWS, LEAVES, RETURNS, Recovery, _displacement
from dextera_build.sim.experts.synthesis import Manner
from dextera_build.sim.runtime.environment import Environment
from tests import gantry, task_bundles

STRICT = Filters(press_n=2.0, depth_m=0.002, grip_m=0.006, speed=1.1, acceleration=1.0, hold_s=0.5)


@pytest.fixture(scope="module")
def driver() -> Driver:
    return Driver(Environment(task_bundles.lift(reset=gantry.RESET)), 0.08)


def made(driver: Driver, perturbed: Recovery, seed: int = 5) -> Episode:
    sources = gantry.demonstrations(driver.environment.bundle, 2)
    manner = Manner(noise=Noise(), filters=STRICT, recovery=perturbed)
    return synthesis.synthesise(driver, sources, driver.environment.draw(seed), seed, manner)


def rows(episode: Episode, name: str) -> slice:
    found = [segment for segment in episode.segments if segment.name == name]
    return slice(found[0].first, found[-1].last)


@pytest.mark.medium
def test_the_label_follows_the_hand_off_its_path_and_leads_back_to_it(driver: Driver) -> None:
    plain = made(driver, Recovery(share=0.0))
    assert plain.success, plain.reason
    assert "perturb" not in {segment.name for segment in plain.segments}
    episode = made(driver, Recovery(share=1.0, position_m=0.02, rotation_rad=0.0))
    assert episode.success, episode.reason
    leaves, returns = rows(episode, "perturb"), rows(episode, "recover")
    assert (leaves.stop - leaves.start, returns.stop - returns.start) == (LEAVES, RETURNS)
    assert leaves.stop == returns.start
    # The gantry's first three joints are the position of its palm [m].
    path = plain.action[: returns.stop, :3]
    hand, label = (
        np.linalg.norm(each[: returns.stop, :3] - path, axis=1) for each in (episode.executed, episode.action)
    )
    assert hand[leaves].max() > 0.01
    assert (np.diff(hand[leaves]) > -1e-6).all()
    # The label stays, then follows nearer to the path, and both are at one place when they turn.
    assert label[leaves][: LEAVES - FOLLOWS].max() < 1e-5
    assert (label[leaves] < hand[leaves] + 1e-5).all()
    assert (hand - label)[leaves].max() > 0.1 * hand[leaves].max()
    off = np.abs(episode.executed - episode.action)[:, :3].max(axis=1)
    assert off[leaves.stop - 1 :].max() < 1e-5
    assert off[: leaves.start].max(initial=0.0) < 1e-5
    assert max(steepest(episode, driver)) < 1.0


def steepest(episode: Episode, driver: Driver) -> tuple[float, float]:
    """Highest speed and acceleration of the arm's label, as multiples of their limits."""
    joints, rate = driver.environment.bundle.robot.joints, driver.environment.task.control_hz
    arm = [number for number, joint in enumerate(joints) if joint.group == "arm"]
    label = episode.action[:, arm].astype(np.float64)
    speed, most = (np.array([getattr(joints[number], name) for number in arm]) for name in ("velocity", "acceleration"))
    return (
        float((np.abs(np.diff(label, axis=0)) * rate / speed).max()),
        float((np.abs(np.diff(label, n=2, axis=0)) * rate**2 / most).max()),
    )


@pytest.mark.medium
def test_a_label_that_jumps_is_found(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    # A label that is on the path until the hand turns, and then jumps to it.
    monkeypatch.setattr(synthesis.Synthesis, "_followed", lambda operator, commands: True)
    monkeypatch.setattr(recovery, "FOLLOWS", 1)
    jumped = made(driver, Recovery(share=1.0, position_m=0.02, rotation_rad=0.0))
    assert jumped.reason.startswith("the label of joint")
    assert jumped.reason.endswith("in `perturb`")


@pytest.mark.medium
def test_a_perturbation_that_the_arm_cannot_follow_is_made_smaller(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = Recovery(share=1.0, position_m=0.08, rotation_rad=0.0)
    monkeypatch.setattr("tests.sim.experts.test_recovery.STRICT", replace(STRICT, acceleration=2.5 / ACCELERATION))
    episode = made(driver, far, seed=9)
    assert episode.success, episode.reason
    assert "perturb" in {segment.name for segment in episode.segments}
    monkeypatch.setattr(synthesis.Synthesis, "_followed", lambda operator, commands: True)
    assert "accelerated" in made(driver, far, seed=9).reason


def test_the_share_is_that_of_the_episodes() -> None:
    drawn = [Recovery(share=0.3).drawn(np.random.default_rng(seed)) for seed in range(2000)]
    assert np.mean(drawn) == pytest.approx(0.3, abs=0.04)


def test_displacements_have_the_stated_covariance() -> None:
    random = np.random.default_rng(0)
    found = np.array([_displacement(Recovery(1.0, 0.02, 0.1), random) for _ in range(4000)])
    assert np.cov(found.T) == pytest.approx(np.diag([0.02**2] * 3 + [0.1**2] * 3), abs=6e-4)


@pytest.mark.medium
def test_without_room_before_the_contact_nothing_is_perturbed(driver: Driver) -> None:
    sources = gantry.demonstrations(driver.environment.bundle, 1)
    (shown,) = sources.items.values()
    grasps = tuple(each.model_copy(update={"contact": True}) for each in shown.segments)
    touching = sources.model_copy(update={"items": {"0": shown.model_copy(update={"segments": grasps})}})
    manner = Manner(noise=Noise(), filters=Filters(press_n=np.inf), recovery=Recovery(share=1.0))
    episode = synthesis.synthesise(driver, touching, driver.environment.draw(1), 1, manner)
    assert "perturb" not in {segment.name for segment in episode.segments}
