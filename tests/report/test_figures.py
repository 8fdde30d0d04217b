"""The figures of the paper, of the pictures in a run: only those that it has, with labels on what replaces hardware."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.tasks.task import WorldKind
from dextera_build.report import cotraining
from dextera_build.report.figures import MOST, figures
from dextera_build.report.layout import made_from
from dextera_build.report.pictures import LADDER, Pictures
from dextera_build.report.run import Node, Run, read
from dextera_build.report.sources import header
from tests import series
from tests.report.fabricate import FakeStore, fabricate

STORE = FakeStore()
WORLDS: tuple[WorldKind, ...] = ("twin", "reference")


def node(address: str, rule: str, needs: tuple[str, ...] = (), *captions: str, **more: Any) -> Node:
    """A node with a picture of its own for each caption."""
    shades = [png(np.full((4, 6, 3), len(STORE.blobs.data) + i, np.uint8)) for i in range(len(captions))]
    made = Node(0, address, rule, more.pop("backend", None), "ran", None, address, 0.0, 1.0, depends_on=[*needs])
    made.previews = [(caption, STORE.blobs.put(shade)) for caption, shade in zip(captions, shades, strict=True)]
    for name, value in more.items():
        setattr(made, name, value)
    return made


def shown(*nodes: Node) -> dict[int, str]:
    """Number of a figure -> its markup."""
    cards, _ = figures(Run(nodes=list(nodes)), Pictures(STORE, LADDER[0]))
    return {int(re.findall(r'id="figure(\d)"', card)[0]): card for card in cards}


def captions(card: str) -> list[str]:
    """Text below each picture."""
    return [re.sub(r"<[^>]*>", "", each) for each in re.findall(r"<figcaption>(.*?)</figcaption>", card)]


@pytest.mark.medium
def test_a_made_up_twin_has_the_figures_of_its_nodes_and_no_other() -> None:
    events, store = fabricate("cold")
    cards, digests = figures(read(events, store), Pictures(store, LADDER[3]))
    assert [re.findall(r'id="(figure\d)"', card) for card in cards] == [["figure1"], ["figure2"], ["figure3"]]
    assert [card.count("<img") for card in cards] == [6, 5, 1]
    assert "simulated" not in "".join(captions("".join(cards)))
    assert len(digests) == 12


def test_a_camera_that_is_simulated_is_labelled_and_a_robot_is_not() -> None:
    robot = node("robot/arm:robot", "simulate.robot", (), "at home")
    for rule, label in (("reference.photograph", "simulated "), ("capture.folder", "")):
        capture = node("photo", rule, ("robot/arm:robot",), "photograph")
        parts = [node("parse", "factorize.parse", ("photo",), "elements"), node("scene", "simulate.scene", ("parse",))]
        found = shown(robot, capture, *parts, node("overlay", "evaluate.overlay", ("scene",), "board"))
        assert captions(found[4]) == ["robot at home", f"{label}photo photograph"]
        assert captions(found[1]) == [f"{label}parse elements"]
        assert captions(found[3]) == [f"{label}overlay board"]


def test_a_task_in_the_twin_is_not_labelled_and_the_same_in_the_other_world_is() -> None:
    world = node("world", "reference.world")
    photo = node("photo", "reference.photograph", ("world",), "photograph")
    twin = node("task", "simulate.task", ("photo", "scene"), "start", artifact="TaskBundle")
    scene = node("scene", "simulate.steady", ("photo",))
    other = node("other", "reference.task", ("task", "world"), "start")
    film = node("film", "demonstrate.film", ("task",), "twin")
    replay = node("replay", "evaluate.replay", ("task", "other"), "both")
    twin.depends_on = ["scene"]
    found = shown(world, photo, scene, twin, other, film, replay)
    assert captions(found[3]) == ["task start", "simulated other start"]
    assert captions(found[7]) == ["simulated replay both", "film twin"]
    assert 4 not in found, "a photograph without a robot is no workspace"


def test_the_picture_of_a_rule_and_the_number_of_pictures() -> None:
    instances = node("objects", "factorize.segment", (), "instances", "clear things")
    many = [node(f"body[b{i}].mesh", "factorize.mesh", (), "seen", f"mesh {i}", backend="a") for i in range(MOST + 2)]
    same = node("again", "factorize.parse", (), "first")
    twice = node("twice", "factorize.parse", (), "second", previews=same.previews)
    told = shown(same, twice, instances, *many)[1]
    assert captions(told) == ["again first", "objects instances", *(f"b{i} mesh mesh {i}" for i in range(MOST - 1))]
    assert "3 more pictures below" in told


def test_a_panel_has_pictures_of_all_its_rules() -> None:
    masks = [node(f"scene[{i}].objects", "factorize.segment", (), "instances") for i in range(MOST)]
    meshes = [node(f"body[b{i}].mesh", "factorize.mesh", (), "mesh", backend="a") for i in range(MOST)]
    told = captions(shown(*meshes, *masks)[1])
    assert told == [f"{i} objects instances" for i in range(3)] + [f"b{i} mesh mesh" for i in range(3)]


def test_stubs_make_no_figure() -> None:
    assert shown(node("parse", "factorize.parse", (), "elements", backend="stub")) == {}


def test_only_objects_of_several_methods_are_compared() -> None:
    def mesh(group: str, label: str, backend: str) -> Node:
        return node(f"{group}[{label}].mesh", "factorize.mesh", (), f"{backend} {label}", backend=backend)

    made = [mesh("body", "mug", "primitives"), mesh("boxes", "mug", "bounding_box"), mesh("body", "cup", "primitives")]
    made += [
        mesh("body", "can", "primitives"),
        mesh("boxes", "can", "bounding_box"),
        mesh("hulls", "can", "convex_hull"),
    ]
    told = shown(*made)[6]
    assert re.findall(r'<th scope="col">([^<]*)', told) == ["primitives", "bounding_box", "convex_hull"]
    assert re.findall(r'<th scope="row">([^<]*)', told) == ["can", "mug"]
    assert captions(told) == [
        *("primitives can", "bounding_box can", "convex_hull can", "primitives mug", "bounding_box mug"),
    ]
    assert 6 not in shown(*made[:1], made[2])


def test_of_several_meshes_of_an_object_the_twins_is_in_the_factorization() -> None:
    made = [
        node(f"{group}[mug].mesh", "factorize.mesh", (), group, backend=group) for group in ("boxes", "body", "hulls")
    ]
    twin = node("scene", "simulate.scene", ("body[mug].mesh",))
    assert captions(shown(*made, twin)[1]) == ["mug mesh body"]
    assert captions(shown(*made)[1]) == ["mug mesh boxes"]


def learned(
    name: str,
    episodes: str,
    world: WorldKind,
    results: list[bool],
    channels: tuple[str, ...] = ("joints", "objects"),
    label: str = "ACT twin only",
) -> list[Node]:
    """A policy, trained on `episodes`, and its trials."""
    made = series.trials(results, label=label, world=world).encode(STORE.blobs.put)
    kind, fields = header(STORE, made)
    trials = node(f"{name}_{world}", "evaluate.rollouts", (name,), artifact=kind, fields=fields)
    contract = {"$value": {"inputs": [{"$value": {"name": channel}} for channel in channels]}}
    learns = {"inputs": {"episodes": episodes}, "artifact": "Checkpoint", "fields": {"contract": contract}}
    return [node(name, "learn.act", (episodes,), **learns), trials]


@pytest.fixture
def trained() -> list[Node]:
    sets = [node(name, "demonstrate.gather") for name in ("episodes", "recorded", "shown")]
    sets.append(node("mixture", "demonstrate.mixture", ("episodes", "recorded")))
    alone = [learned("alone", "episodes", world, [True, False]) for world in WORLDS]
    told, most = ("joints", "objects", "world"), [True, True, True, False]
    both = [learned("act", "mixture", world, most, told, "ACT") for world in WORLDS]
    return [*sets, *alone[0], alone[1][1], *both[0], both[1][1]]


def test_bars_stand_where_a_policy_was_trained_both_ways(trained: list[Node]) -> None:
    assert made_from(Run(nodes=trained), "demonstrate.mixture") == {"mixture", "act", "act_twin", "act_reference"}
    told = shown(*trained)[8]
    assert re.findall(r"<title>([^<]*)", told) == ["1 of 2", "3 of 4"] * 2
    assert re.findall(r"<text[^>]*>([^<]*)", told) == [
        *("twin", "50", "75", "ACT"),
        *("reference, simulated", "50", "75", "ACT"),
    ]
    heights = [float(value) for value in re.findall(r'height="([\d.]+)" class="success', told)]
    assert heights == pytest.approx([0.5 * cotraining.HIGH, 0.75 * cotraining.HIGH] * 2, abs=0.06)
    assert 8 not in shown(*(each for each in trained if each.rule != "demonstrate.mixture"))


def test_a_policy_that_learned_something_else_has_no_bar(trained: list[Node]) -> None:
    """A teacher's student of the same algorithm has other episodes, a policy of pictures has other channels."""
    student = learned("taught.student", "shown", "twin", [False], label="T-S")
    sees = learned("two_cameras.act", "episodes", "twin", [False], ("joints", "rgb"), "ACT two cameras")
    expected = shown(*trained)[8]
    assert shown(*student, *sees, *trained)[8] == expected
    with_trials = [each for each in trained if each.name.startswith(("alone", "act"))]
    sets = [each for each in trained if each not in with_trials]
    mixed = [each for each in with_trials if each.name.startswith("act")]
    assert 8 not in shown(*sets, *student, *sees, *mixed)
