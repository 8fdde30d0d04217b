"""Errors of planning, and the order in which candidates are tried."""

from __future__ import annotations

import pytest

from dextera_build.errors import RuleError
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.rehearse import taking_turns
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles


def test_a_hand_without_grips_is_refused() -> None:
    driver = Driver(Environment(task_bundles.lift()))
    with pytest.raises(RuleError, match="no frame `tip_thumb`") as caught:
        planning.practise(driver)
    assert caught.value.code == "DXB-B252"


def test_every_way_has_its_turn() -> None:
    ways = ["a", "a", "a", "b", "c", "b"]
    assert taking_turns(range(6), ways) == [0, 3, 4, 1, 5, 2]
