"""What `dxb view` finds behind a node: the world of its episodes, materials of objects, and the right episode."""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.cli import built
from dextera_build.cli.look import result, show, shown
from dextera_build.errors import RuleError, UsageError
from tests import episodes, factories, series


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A recipe `task/lift` whose nodes were made from what a test puts into `behind`, nearest first."""
    project = SimpleNamespace(recipe=lambda name: None)
    made = SimpleNamespace(project=project, recipe="task/lift", artifacts={}, behind=[], history={}, bare=set())

    def found(session: Any, node: str, kind: type[Artifact]) -> Iterator[tuple[str, Artifact]]:
        yield from ((address, each) for address, each in made.behind if isinstance(each, kind))

    monkeypatch.setattr(shown.ancestors, "found", found)
    monkeypatch.setattr(shown.fetch, "bring", lambda session, nodes: made.bare & {*nodes})
    made.artifact = made.artifacts.__getitem__
    return made


def test_trials_are_shown_in_the_world_that_they_took_place_in(session: Any) -> None:
    twin = episodes.bundle()
    world = twin.model_copy(update={"kind": "reference"})
    session.behind = [("task", twin), ("reference", world)]
    assert shown._world(session, "sources", episodes.small(1, 3)) is twin
    assert shown._world(session, "act", series.trials([True], world="reference")) is world
    with pytest.raises(RuleError, match="is not in the store"):
        shown._world(session, "act", series.trials([True], world="perturbed"))


def test_materials_are_those_of_the_assets_by_the_names_of_bodies(session: Any) -> None:
    box: Asset = factories.box_asset()
    session.behind = [("twin/desk:body[Blue Mug].asset", box), ("twin/desk:body[lid].asset", box)]
    material = box.physics.material
    assert shown._materials(session, "task") == {"blue_mug": material, "lid": material}


def test_an_episode_is_chosen_by_its_index(session: Any) -> None:
    session.behind = [("task", episodes.bundle())]
    session.artifacts["sources"] = episodes.small(2, 3)
    assert callable(shown.of(session, "sources", "2"))  # the failure
    with pytest.raises(UsageError, match="has no episode `7`") as caught:
        shown.of(session, "sources", "7")
    assert caught.value.facts == {"episodes": "0, 1, 2"}


def test_an_episode_of_what_holds_none_is_refused(session: Any) -> None:
    session.artifacts["made"] = factories.box_asset()
    for node in ("made", ""):
        with pytest.raises(UsageError, match="holds no episodes"):
            shown.of(session, node, "3")


def test_a_number_names_the_episode_whatever_its_zeros(session: Any) -> None:
    session.behind = [("task", episodes.bundle())]
    made = episodes.small(2, 3)
    session.artifacts["made"] = made.model_copy(update={"items": {f"{int(n):05d}": e for n, e in made.items.items()}})
    assert callable(shown.of(session, "made", "1"))
    with pytest.raises(UsageError, match="has no episode `7`"):
        shown.of(session, "made", "7")


def test_a_task_without_a_robot_says_so(session: Any) -> None:
    from dextera_build.artifacts.base import Folder
    from dextera_build.view.task import TaskView

    empty = Folder(files={"scene.xml": b"<mujoco/>"})
    bundle: TaskBundle = episodes.bundle().model_copy(update={"model": empty})
    with pytest.raises(RuleError, match="cannot run"):
        TaskView(None, "/task", bundle, {})


@pytest.mark.parametrize(
    ("made", "is_viewed"),
    [
        ({"task": "TaskBundle"}, True),
        ({"task/lift:task": "TaskBundle", "table": "Table"}, False),
        ({"arm": "RobotModel"}, True),
        ({"photo": "Capture"}, False),
        ({"photo": "Capture", "ground": "Support", "background": "Background"}, True),
        ({"d:photo": "Capture", "d:ground": "Support", "d:background": "Background"}, True),
    ],
)
def test_a_build_proposes_to_view_what_can_be_viewed(made: dict[str, str], is_viewed: bool) -> None:
    store = SimpleNamespace(blobs=SimpleNamespace(get=lambda kind: json.dumps({"artifact": kind})))
    nodes = [SimpleNamespace(node=node, rule=f"a.{kind}", output=kind) for node, kind in made.items()]
    nodes.append(SimpleNamespace(node="failed", rule="a.b", output=None))
    assert built.is_viewed(SimpleNamespace(store=store), nodes) is is_viewed  # type: ignore[arg-type]


def test_a_task_recipe_shows_its_task_and_not_the_scene_that_it_reads(
    session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = {kind: [f"twin/desk:{kind.lower()}"] for kind in (*shown.PARTS, "Asset")}
    monkeypatch.setattr(built, "by_type", lambda _: {**nodes, "TaskBundle": ["task/other:task", "task"]})
    session.artifacts["task"] = episodes.bundle()
    assert shown.of(session, "").__qualname__.startswith("_task.")
    monkeypatch.setattr(built, "by_type", lambda _: {"Capture": ["twin/desk:capture"]})
    with pytest.raises(UsageError, match="no scene to show yet") as caught:
        shown.of(session, "")
    assert caught.value.facts == {"missing": "Background, Support"}


def test_fields_are_told_in_a_few_digits_and_without_the_marks_of_headers() -> None:
    store = SimpleNamespace(blobs=SimpleNamespace(has=lambda _: True, get=lambda _: json.dumps(inner)))
    inner = {"artifact": "Camera", "fields": {"cx": 310.2588195800781, "names": {"$map": {}}}}
    session: Any = SimpleNamespace(store=store)
    digest = "d35c" * 16
    for value, told in (
        ({"$ref": digest}, "Camera, cx 310.259"),
        ({"$map": {}}, "none"),
        ({"$map": {"a": {}, "b": {}}}, "a, b"),
        ([{"$ref": digest}], '["d35cd35cd35c"]'),
        ([{"$value": {"name": "mug", "mass_kg": 0.30000001}}], '[{"name": "mug", "mass_kg": 0.3}]'),
    ):
        assert result._field(session, value)["told"] == told


def test_a_narrow_terminal_gets_the_first_digits_of_digests() -> None:
    rows = [{"name": "key", "value": "d35c" * 16}, {"name": "line", "value": "a deadbeef word"}]
    assert show.shortened(rows) == [{"name": "key", "value": "d35cd35cd35c"}, rows[1]]
