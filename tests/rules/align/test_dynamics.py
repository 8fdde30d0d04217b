"""align.dynamics: what recordings of a robot in a known world tell about it, and what they do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from rules.align.dynamics import fit
from rules.align.dynamics.arm import Arm, Values
from rules.align.dynamics.dynamics_mujoco import reach_of, run_of
from rules.align.dynamics.estimates import Gate, prior_of
from rules.align.dynamics.phases import Phases, phases
from tests import episodes, recorded_lifts, task_bundles

HZ, REACH = 20.0, 0.15
UP = np.array([0.0, 0.0, 1.0])
CORNERS = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])


def estimate(folder: Path, given: Episodes, **options: Any) -> tuple[DynamicsEstimate, RuleRunner]:
    runner = RuleRunner(folder)
    made = runner.run("align.dynamics", bundle=recorded_lifts.twin(), episodes=given, options=options)
    assert isinstance(made, DynamicsEstimate)
    return made, runner


@pytest.mark.medium
def test_two_lifts_tell_the_mass_and_the_controllers_but_not_the_friction(tmp_path: Path) -> None:
    there = recorded_lifts.world()
    found, runner = estimate(tmp_path, recorded_lifts.recorded(there, "lift", "lift"))
    mass = found.objects["box"].mass_kg
    assert mass.identified
    assert mass.value == pytest.approx(recorded_lifts.MASS_KG, rel=0.1)
    assert abs(np.log(mass.value / recorded_lifts.MASS_KG)) < 2 * mass.sigma < mass.prior_sigma
    assert found.latency_s.value == pytest.approx(recorded_lifts.LATENCY_S, abs=0.001)
    for joint, rail in found.joints.items():
        assert rail.friction.identified, joint
        assert rail.friction.value == pytest.approx(200 * recorded_lifts.SHARE, abs=2 * rail.friction.sigma)
    friction = found.objects["box"].friction
    assert (friction.value, friction.sigma) == (0.6, 0.16)
    assert friction.why == "the object was carried and never pushed"
    (warning,) = runner.outcome.warnings
    assert "friction of box is not identifiable from these recordings: the object was carried" in warning


@pytest.mark.slow
def test_planted_forces_of_pushes_and_a_known_mass_tell_the_friction() -> None:
    """The robot's joints are those of the simulated arm, so that every number is known exactly."""
    bundle = recorded_lifts.twin()
    arm = Arm(bundle)
    given = recorded_lifts.recorded(recorded_lifts.world(), "push", "push", "wave")
    runs = [run_of(arm, bundle, episode, reach_of(bundle)) for episode in given.items.values()]
    planted = Values(
        log_stiffness=np.array([0.02, -0.03, 0.01]),
        log_lag=np.array([0.1, -0.1, 0.05]),
        friction=np.array([0.012, 0.008, 0.01]),
        latency_s=0.013,
        log_mass=0.2,
        mu=0.42,
        lifted=-0.1,
    )
    runs = [replace(run, joints=arm.simulate(run, planted)) for run in runs]
    prior = prior_of(bundle, arm, (arm.payload.mass_kg * np.exp(0.2), 0.01))
    found = fit.fit(arm, runs, prior, 8)
    layout, sigma = fit.Layout(3), np.sqrt(np.diag(found.covariance))
    assert layout.values(found.values).mu == pytest.approx(0.42, abs=2 * sigma[layout.common("mu")])
    assert sigma[layout.common("mu")] < 0.04
    assert np.abs(found.values - layout.vector(planted))[3:] == pytest.approx(np.zeros(13), abs=0.05)
    assert found.residual < 2e-5


@pytest.mark.slow
def test_pushes_alone_tell_neither_of_mass_and_friction(tmp_path: Path) -> None:
    given = recorded_lifts.recorded(recorded_lifts.world(), "push", "wave")
    thing = estimate(tmp_path, given)[0].objects["box"]
    assert thing.mass_kg.why.startswith("its standard deviation would be 0.")
    assert (thing.friction.value, thing.friction.sigma) == (0.6, 0.16)


@pytest.mark.medium
def test_without_contact_only_the_robot_is_identified(tmp_path: Path) -> None:
    found, _ = estimate(tmp_path, recorded_lifts.recorded(recorded_lifts.world(), "wave"))
    assert [each.why for _, each in found.objects["box"]] == ["the object was never moved"] * 2
    assert found.latency_s.identified
    assert found.periods["carried"] == found.periods["pushed"] == 0


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: recorded_lifts.recorded(task_bundles.lift(), "wave"), "simulated in the twin, which cannot learn"),
        (lambda: episodes.small().model_copy(update={"world": "real"}), "the data set does not fit the task bundle"),
        (lambda: _shortened(), "no recording has 20 control periods"),
    ],
)
def test_recordings_that_cannot_be_used_are_refused(tmp_path: Path, make, error: str) -> None:
    with pytest.raises(RuleError, match=error):
        estimate(tmp_path, make())


def _shortened() -> Episodes:
    given = recorded_lifts.recorded(recorded_lifts.world(), "wave")
    (one,) = given.items.values()
    cut = {"action": one.action[:9], "executed": one.executed[:9], "hand": one.hand[:9]}
    terms = {name: values[:9] for name, values in one.terms.items()}
    return given.model_copy(update={"items": {"0": one.model_copy(update={**cut, "terms": terms})}})


def test_what_is_hardly_narrower_stays_as_it_was() -> None:
    stated = fit.Prior(np.array([0.0, 0.0]), np.array([0.2, 0.2]))
    found = fit.Fit(np.array([0.3, 0.3]), np.diag([0.05**2, 0.15**2]), 1e-4)
    gate = Gate(stated, found, 0.5)
    assert gate.passed(0, 2.0, 0.0, log=True).value == pytest.approx(2.0 * np.exp(0.3))
    assert gate.passed(0, 2.0, 0.0).sigma == pytest.approx(0.1)
    kept = gate.passed(1, 2.0, 0.0, log=True)
    assert (kept.value, kept.sigma, kept.why) == (2.0, 0.2, "its standard deviation would be 0.15 after 0.2")
    # What all recordings share is not narrowed by many of them.
    assert not gate.passed(0, 2.0, 0.1, log=True).identified


def test_neighbouring_residuals_do_not_count_as_independent() -> None:
    random = np.random.default_rng(0)
    noise = random.standard_normal((4000, 2))
    for row in range(1, len(noise)):
        noise[row, 1] = 0.6 * noise[row - 1, 1] + 0.8 * noise[row, 1]
    times = fit.autocorrelation_time([noise], [np.ones(len(noise), bool)], (noise**2).mean(axis=0))
    assert times == pytest.approx([1.0, (1 + 0.6) / (1 - 0.6)], rel=0.15)


# Objects on a table, seen by an exact tracker 20 times a second; hands come from afar.


def _seen(places: np.ndarray) -> np.ndarray:
    return np.array([transforms.rigid(np.eye(3), place) for place in places])


def _divided(place: np.ndarray, *hands: np.ndarray) -> Phases:
    return phases({str(n): _seen(hand) for n, hand in enumerate(hands)}, _seen(place), CORNERS, UP, REACH, HZ)


def _approach(place: np.ndarray, aside: float = 0.0) -> np.ndarray:
    """A hand 0.1 m above the object's first place after two seconds, which then moves with it."""
    hand = place + np.array([0.0, aside, 0.1])
    hand[:60, 0] += np.maximum(0.0, np.linspace(0.5, -0.25, 60))
    return hand


def _moving(rate: np.ndarray) -> np.ndarray:
    """An object that moves after three seconds, for two."""
    return np.clip(np.arange(120) / HZ - 3.0, 0.0, 2.0)[:, None] * rate


def test_an_object_that_rises_with_a_hand_is_carried() -> None:
    place = _moving(np.array([0.0, 0.0, 0.05]))
    found = _divided(place, _approach(place))
    assert found.carried is not None
    assert found.held is not None
    assert found.pushed is None
    # Not while the arm takes up the weight, and not before the object is certainly off its support.
    assert np.flatnonzero(found.carried)[0] == 70
    assert found.carried[-1]
    assert found.held[:3, 3] == pytest.approx([0.0, 0.0, -0.1], abs=1e-3)
    # Free only while the hand is farther than its fingers reach.
    assert found.free[:20].all()
    assert not found.free[40:].any()


def test_an_object_that_moves_along_its_support_is_pushed() -> None:
    place = _moving(np.array([0.05, 0.0, 0.0]))
    found = _divided(place, _approach(place))
    assert found.carried is None
    assert found.pushed is not None
    assert found.sliding is not None
    # It slides from 60 to 100: not while the arm settles, and not when a late tracker might show what is over.
    assert np.flatnonzero(found.pushed)[[0, -1]] == pytest.approx([66, 96], abs=1)
    assert found.sliding[80] == pytest.approx([1.0, 0.0, 0.0])
    assert not found.sliding[:55].any()


@pytest.mark.parametrize(
    ("rate", "asides", "why"),
    [
        ((0.0, 0.0, 0.0), (0.0,), "the object was never moved"),
        ((0.0, 0.0, 0.05), (0.05, -0.05), "two hands carried the object, and what they press on one another"),
        ((0.006, 0.0, 0.0), (0.0,), "the object never slid for more than 0.5 s"),
    ],
)
def test_contact_that_tells_nothing_has_a_reason(rate, asides, why: str) -> None:
    place = _moving(np.array(rate))
    found = _divided(place, *(_approach(place, aside) for aside in asides))
    assert found.why.startswith(why)
    assert found.carried is None
    assert found.pushed is None


def test_an_object_that_is_thrown_is_not_carried() -> None:
    place = _moving(np.array([0.0, 0.0, 0.05]))
    hand = _approach(place) - 4 * place  # falls as the object rises
    assert _divided(place, hand).why == "the object did not stay in the hand that raised it"
