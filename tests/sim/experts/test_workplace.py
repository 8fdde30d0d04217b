"""A recording of hands that was made with another task or robot is refused, unless that is meant."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.hand_stream import HandStream, Workplace
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.experts import workplace
from tests import task_bundles
from tests.hand_streams import stream


@pytest.fixture(scope="module")
def bundle() -> TaskBundle:
    return task_bundles.lift()


def recorded(bundle: TaskBundle, **changes: object) -> HandStream:
    place = workplace.of(bundle)
    return stream(4, workplace=place.model_copy(update=changes))


def test_the_same_task_and_robot_are_taken_without_a_doubt(bundle: TaskBundle) -> None:
    assert workplace.check(recorded(bundle), bundle) == ""


def test_what_is_not_known_is_taken(bundle: TaskBundle) -> None:
    assert workplace.check(stream(4), bundle) == ""
    assert workplace.check(recorded(bundle, model=""), bundle) == ""


@pytest.mark.parametrize(
    ("changes", "what", "accept"),
    [
        ({"task": "StackBowls"}, "task", "[task]"),
        ({"robot": "another", "joints": ("a", "b")}, "robot", "[robot]"),
        ({"task": "StackBowls", "joints": ("a", "b")}, "task and another robot", "[task, robot]"),
    ],
)
def test_another_one_is_refused_with_what_was_recorded(
    bundle: TaskBundle, changes: dict[str, object], what: str, accept: str
) -> None:
    with pytest.raises(RuleError, match=f"recorded with another {what}\n") as caught:
        workplace.check(recorded(bundle, **changes), bundle)
    place = workplace.of(bundle).model_copy(update=changes)
    assert caught.value.code == "DXB-B533"
    assert caught.value.facts["recorded"] == f"{place.task} with {place.robot}, {len(place.joints)} joints"
    assert f"accept_other: {accept}" in caught.value.hint


def test_another_one_that_is_meant_is_told(bundle: TaskBundle) -> None:
    both = recorded(bundle, task="StackBowls", joints=("a", "b"))
    with pytest.raises(RuleError, match=r"another robot\n"):
        workplace.check(both, bundle, ["task"])
    assert "recorded in StackBowls with " in workplace.check(both, bundle, ["task", "robot"])


def test_a_robot_is_told_by_its_joints_and_not_by_its_limits_or_name(bundle: TaskBundle) -> None:
    assert workplace.check(recorded(bundle, robot="renamed"), bundle) == ""


def test_another_model_of_the_same_task_is_doubted(bundle: TaskBundle) -> None:
    moved = {**bundle.model.files, "scene.xml": bundle.model.files["scene.xml"] + b" "}
    other = bundle.model_copy(update={"model": Folder(files=moved)})
    assert "model is another one" in workplace.check(recorded(bundle), other)


def test_a_workplace_needs_a_task() -> None:
    with pytest.raises(ValueError, match="task"):
        Workplace(task="", robot="", joints=())
