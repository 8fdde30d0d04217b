"""Errors of planning, and the order in which candidates are tried."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.robots.limb import Grip
from dextera_build.errors import RuleError
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.candidates import Expert
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.rehearse import Candidate, taking_turns
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles


def test_a_hand_without_grips_is_refused() -> None:
    driver = Driver(Environment(task_bundles.lift()))
    with pytest.raises(RuleError, match="no frame `tip_thumb`") as caught:
        planning.practise(driver)
    assert caught.value.code == "DXB-B252"


def test_what_pushes_needs_no_thumb() -> None:
    robot = task_bundles.lift().robot
    limb = robot.limbs["arm"]
    pushes = Grip(against="nothing", open={})
    able = robot.model_copy(update={"limbs": {"arm": limb.model_copy(update={"grips": {"point": pushes}})}})
    planning._check_hand(able, "arm", "nothing")
    bare = robot.model_copy(update={"limbs": {"arm": limb.model_copy(update={"tips": (), "grips": {"point": pushes}})}})
    with pytest.raises(RuleError, match="no frame `tip`"):
        planning._check_hand(bare, "arm", "nothing")


def test_every_way_has_its_turn() -> None:
    ways = ["a", "a", "a", "b", "c", "b"]
    assert taking_turns(range(6), ways) == [0, 3, 4, 1, 5, 2]


def test_without_a_candidate_the_attempts_of_anyway_hold_still_and_tell_why(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = Environment(task_bundles.lift())
    driver = Driver(environment)
    monkeypatch.setattr(planning, "experts", lambda primitive: [Expert("nothing", lambda search: [])])
    monkeypatch.setattr(planning, "_check_hand", lambda *_: None)
    with pytest.raises(RuleError, match="out of reach") as caught:
        planning.practise(driver)
    assert caught.value.code == "DXB-B250"
    assert caught.value.facts["joints"] == "`arm` has 3, and a hand is turned freely by 6"
    start = starts.photographed(environment.bundle, environment.model)
    episode = driver.run(planning.practise(driver, anyway=True), start, origin="operator")
    assert not episode.success
    assert "is out of reach" in episode.reason
    assert len(episode.joints) == round(environment.task.control_hz)
    assert (episode.action == episode.action[0]).all()


def test_without_a_success_the_attempts_of_anyway_are_those_of_the_likeliest(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Driver(Environment(task_bundles.lift()))
    likeliest, other = (planning.Unable(name) for name in ("likeliest", "other"))
    found = [Candidate(each.reason, "way", each) for each in (likeliest, other)]
    monkeypatch.setattr(planning, "experts", lambda primitive: [Expert("nothing", lambda search: found)])
    monkeypatch.setattr(planning, "_check_hand", lambda *_: None)
    monkeypatch.setattr(planning, "rehearse", lambda *_: [])
    with pytest.raises(RuleError, match="no rehearsal of") as caught:
        planning.practise(driver)
    assert (caught.value.code, caught.value.facts) == ("DXB-B251", {"candidates": "2", "first": "likeliest"})
    assert planning.practise(driver, anyway=True) is likeliest


def test_the_reasons_of_failed_rehearsals_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Driver(Environment(task_bundles.lift()))
    reasons = ["too far", "in the way", "too far"]
    found = [Candidate(str(number), "way", planning.Unable(reason)) for number, reason in enumerate(reasons)]
    monkeypatch.setattr(planning, "experts", lambda primitive: [Expert("nothing", lambda search: found)])
    monkeypatch.setattr(planning, "_check_hand", lambda *_: None)
    with pytest.raises(RuleError, match="no rehearsal of") as caught:
        planning.practise(driver)
    assert caught.value.facts["failed"] == "too far (2x), in the way (1x)"
