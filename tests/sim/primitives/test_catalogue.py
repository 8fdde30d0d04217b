"""What every primitive has: a name, options in `simulate.task`, a goal with numbers, a value, a reason."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dextera_build import digest
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.code.loader import bundled
from dextera_build.errors import RuleError
from dextera_build.sim import primitives
from dextera_build.sim.experts.candidates import experts
from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.primitives import base, catalogue, folders
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from dextera_build.sim.primitives.base import TypedGoal
from dextera_build.sim.primitives.handover.primitive import HandoverGoal
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.pick_and_reorient.primitive import ReorientGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.primitives.push.primitive import PushGoal
from dextera_build.sim.runtime.environment import Environment
from tests import factories, task_bundles

NEAR = Tolerance(position_m=0.02, rotation_rad=0.2)
TURN = (0.8, 0.0, 0.6, 0.0)
GOALS: dict[str, TypedGoal] = {
    "lift": LiftGoal(height_m=0.1),
    "push": PushGoal(place_m=(0.3, 0.2), yaw_rad=0.5, upright=(1.0, 0.0, 0.0, 0.0), tolerance=NEAR),
    "pick_and_reorient": ReorientGoal(place_m=(0.1, 0.2, 0.3), quaternion=TURN, tolerance=NEAR),
    "pick_and_place": PlaceGoal(place_m=(0.1, 0.2, 0.02), tolerance=NEAR),
    "handover": HandoverGoal(giver="left", receiver="right"),
}


def test_every_folder_is_a_primitive_with_a_script() -> None:
    folder = Path(primitives.__path__[0])
    names = {file.parent.name for file in folder.glob("*/*.py")}
    assert names == {*GOALS, "articulate"}
    for name in names:
        assert catalogue.kind(name).goal_type.model_fields["primitive"].default == name
        assert issubclass(folders.module(name, "primitive").Options, base.Options)
        assert experts(name)


def test_nothing_imports_a_primitive_but_by_name() -> None:
    """What imports one would have its code in its key, and that of every task."""
    package = Path(primitives.__path__[0]).parent.parent
    names = "|".join({*GOALS, "articulate"})
    imports = re.compile(rf"sim\.primitives(\.| import )({names})\b")
    sources = [*package.rglob("*.py"), *(bundled("rules")).rglob("*.py")]
    found = [file for file in sources if imports.search(file.read_text())]
    assert {file.parent.parent.name for file in found} == {"primitives"}


def test_a_primitive_that_does_not_exist_is_one_clear_error() -> None:
    with pytest.raises(RuleError, match="no primitive of dxb is called `lfit`") as caught:
        catalogue.kind("lfit")
    assert caught.value.hint == "did you mean `lift`?"
    with pytest.raises(RuleError, match="no primitive of dxb is called"):
        catalogue.kind("../lift")


@pytest.mark.parametrize("made", [GOALS["push"], ArticulateGoal(joints={"b": 0.2, "a": 0.1}, tolerance=0.1)])
def test_a_stored_goal_is_that_of_its_primitive(made: TypedGoal) -> None:
    bundle = task_bundles.lift()
    task = bundle.task.model_copy(update={"goal": made})
    stored: dict[str, bytes] = {}
    key = bundle.model_copy(update={"task": task}).encode(lambda data: _kept(stored, data))
    back = type(bundle).decode(key, stored.__getitem__)
    assert type(back.task.goal) is Goal
    assert catalogue.of(back.task, back.objects).goal == made
    assert back.task.goal.names == made.names
    assert catalogue.of(back.task).goal.numbers(np.eye(4)) == made.numbers(np.eye(4))
    again: dict[str, bytes] = {}
    assert back.encode(lambda data: _kept(again, data)) == key


def _kept(blobs: dict[str, bytes], data: bytes) -> str:
    key = digest.of_bytes(data)
    blobs[key] = data
    return key


@pytest.mark.parametrize("name", GOALS)
def test_an_episode_of_every_primitive_runs_and_says_why_it_failed(name: str) -> None:
    bundle = task_bundles.lift()
    goal = GOALS[name]
    task = bundle.task.model_copy(update={"goal": goal, "timeout_s": 0.2})
    environment = Environment(bundle.model_copy(update={"task": task}))
    assert task.primitive == name
    assert len(goal.names) == len(environment.goal) == len(environment.observe()["goal"])
    assert np.isfinite(environment.goal).all()
    assert np.isfinite(Progress(environment).value(False))
    outcome = environment.step(environment.previous_action)
    while not outcome.over:
        outcome = environment.step(environment.previous_action)
    assert not outcome.success
    assert outcome.reason.startswith("not done within 0.2 s: ")
    assert not any(letter.isdigit() for letter in outcome.reason.partition(": ")[2])


@pytest.mark.parametrize("name", ["push", "pick_and_reorient", "pick_and_place"])
def test_policies_see_a_target_in_the_base_wherever_the_robot_stands(name: str) -> None:
    base = factories.pose(0.4, -0.2, 0.1, yaw=0.8)
    numbers = np.array(GOALS[name].numbers(np.linalg.inv(base)))
    place = GOALS[name].place_m  # type: ignore[union-attr]
    seen = np.linalg.inv(base) @ [*place, *([0.0] if len(place) == 2 else []), 1.0]  # type: ignore[misc,arg-type]
    assert numbers[: len(place)] == pytest.approx(seen[: len(place)])  # type: ignore[arg-type]
    moved = np.array(GOALS[name].numbers(np.eye(4)))
    assert not np.allclose(numbers, moved)
