"""What a policy is told of the objects of its task."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning.demonstrations import Selection, prepare
from dextera_build.learning.parts import parts_of
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.testing import RuleRunner
from tests import episodes

NEAR = Tolerance(position_m=0.03, rotation_rad=0.3)


@pytest.fixture(scope="module")
def into_the_case() -> TaskBundle:
    """The task of `episodes.small`, but the box is put into the case, wherever that is."""
    bundle = episodes.bundle()
    goal = PlaceGoal(into="case", tolerance=NEAR)
    return bundle.model_copy(update={"task": bundle.task.model_copy(update={"goal": goal})})


def test_who_puts_a_thing_into_another_one_sees_both(into_the_case: TaskBundle) -> None:
    shown = parts_of(episodes.small(3, 6))
    wanted = Selection(("objects", "displacement"))
    lift = prepare(episodes.bundle(), shown, wanted, algorithm="act", settings={})
    assert [channel.names for channel in lift.contract.inputs] == [("box",)]
    into = prepare(into_the_case, shown, wanted, algorithm="act", settings={})
    assert [channel.names for channel in into.contract.inputs] == [("box", "case"), ("case_lid_hinge",)]
    assert np.array_equal(into.inputs["objects"][:, :1], lift.inputs["objects"])


def test_reinforcement_learning_sees_both_too(into_the_case: TaskBundle, tmp_path) -> None:
    made = RuleRunner(tmp_path).run("learn.ppo", backend="stub", bundle=into_the_case)
    seen = {channel.name: channel for channel in made.contract.inputs}
    assert seen["objects"].names == ("box", "case")
    assert seen["displacement"].names == ("case_lid_hinge",)
    placed = (into_the_case.base_pose.inverse() @ into_the_case.objects["case"].pose).matrix[:3, 3]
    assert np.reshape(seen["objects"].mean, (2, 9))[1, :3] == pytest.approx(placed, abs=1e-6)
