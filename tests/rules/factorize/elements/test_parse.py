"""What is found and named in rendered tabletops, and what a scene file makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import File
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories, tabletops
from tests.recipes import two_states

RED, BLUE, WHITE = (0.75, 0.1, 0.1), (0.15, 0.2, 0.7), (0.9, 0.9, 0.9)


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


THREE = (
    (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.16, 0.02, yaw=0.5)),
    (tabletops.bowl(WHITE), factories.pose(0.03, -0.1)),
    (tabletops.cylinder(0.035, 0.12, BLUE), factories.pose(0.18, 0.06)),
)
"""A red box, a white bowl and a blue cylinder, apart."""


@pytest.fixture(scope="module")
def three():
    return tabletops.tabletop(*THREE)


@pytest.fixture(scope="module")
def fine():
    """The same with the pixels that tell the cylinder's shape."""
    return tabletops.tabletop(*THREE, lens=tabletops.FINE)


def parsed(runner, scene, text: str | None = None, profile: str = "cpu"):
    support = runner.run("align.support", **factories.shot(scene.capture))
    described = {} if text is None else {"scene": File(data=text.encode())}
    return runner.run("factorize.parse", profile=profile, **factories.shot(scene.capture), support=support, **described)


def interactive(elements) -> dict[str, object]:
    return {element.name: element for element in elements.elements if element.interactive}


@pytest.mark.medium
def test_things_are_named_by_colour_and_shape(runner, fine):
    found = interactive(parsed(runner, fine))
    assert set(found) == {"red_box", "white_bowl", "blue_cylinder"}
    assert found["white_bowl"].category == "bowl"
    assert found["white_bowl"].material == "ceramic"
    assert found["red_box"].phrase == "red box"
    assert all(element.body_type == "rigid" for element in found.values())


@pytest.mark.medium
def test_boxes_are_tight(runner, fine):
    found = interactive(parsed(runner, fine))
    for number, name in enumerate(("red_box", "white_bowl", "blue_cylinder"), start=1):
        rows, columns = np.nonzero(fine.labels.labels == number)
        truth = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        assert np.abs(truth - found[name].box).max() <= 4, name


@pytest.mark.medium
def test_equal_things_get_numbers(runner):
    scene = tabletops.tabletop(
        *((tabletops.box(0.07, 0.05, 0.1, RED), factories.pose(x, 0.0, yaw=0.3)) for x in (-0.15, 0.0, 0.15))
    )
    assert set(interactive(parsed(runner, scene))) == {"red_box", "red_box_2", "red_box_3"}


@pytest.mark.medium
def test_a_laptop_is_one_articulated_thing(runner):
    links = factories.laptop_asset(opening=1.9).body.links
    lid = links["lid"].mesh
    turn = np.array([[1, 0, 0], [0, np.cos(1.9), np.sin(1.9)], [0, -np.sin(1.9), np.cos(1.9)]])
    hinge = np.array([0.0, 0.11, 0.0165])
    opened = lid.model_copy(update={"vertices": ((lid.vertices - hinge) @ turn.T + hinge).astype(np.float32)})
    scene = tabletops.tabletop((links["base"].mesh, factories.pose()), (opened, factories.pose()))
    found = interactive(parsed(runner, scene))
    assert [element.category for element in found.values()] == ["laptop"]
    assert [element.body_type for element in found.values()] == ["articulated"]


@pytest.mark.slow
def test_a_laptop_of_which_the_network_joins_lid_and_base_is_one_too(runner):
    scene = two_states.shown(two_states.OPENED[0], two_states.BOX[0])
    found = interactive(parsed(runner, scene))
    assert sorted(element.category for element in found.values()) == ["box", "laptop"]


def test_a_box_on_a_board_is_no_laptop(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.3, 0.25, 0.02, WHITE), factories.pose()),
        (tabletops.box(0.2, 0.02, 0.2, BLUE), factories.pose(0, 0, 0.02)),
    )
    assert {element.category for element in interactive(parsed(runner, scene)).values()} == {"box"}


def test_what_reaches_out_of_the_image_is_static(runner):
    arm = factories.box_mesh((-0.03, -0.02, 0.2), (0.03, 0.05, 1.2), colour=(0.3, 0.3, 0.3))
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.16, 0.02, yaw=0.5)),
        (arm, factories.pose(0.1, 0.1)),
    )
    found = parsed(runner, scene).elements
    assert [element.name for element in found if element.interactive] == ["red_box"]
    assert {element.category for element in found if not element.interactive} == {"room", "support"}


@pytest.mark.slow
def test_what_stands_on_furniture_is_found(runner):
    """A step along the back of the table is too wide for an object, and carries two."""
    scene = tabletops.tabletop(
        (tabletops.bowl(WHITE), factories.pose(0.1, -0.15)),
        (tabletops.box(0.9, 0.27, 0.12, (0.5, 0.4, 0.25)), factories.pose(0.0, 0.29)),
        (tabletops.cylinder(0.03, 0.1, BLUE), factories.pose(-0.08, 0.27, 0.12)),
        (tabletops.box(0.06, 0.05, 0.08, RED), factories.pose(0.07, 0.25, 0.12)),
        eye=factories.look_at((0.0, -0.75, 0.75)),
        lens=tabletops.FINE,
    )
    found = parsed(runner, scene).elements
    assert {element.phrase.split()[0] for element in found if element.interactive} == {"white", "blue", "red"}
    assert [element.name for element in found if not element.interactive] == ["fixture", "support"]


@pytest.mark.medium
def test_what_hangs_in_the_air_is_static(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.12, 0.0, yaw=0.5)),
        (tabletops.box(0.06, 0.06, 0.06, BLUE), factories.pose(0.1, 0.0, 0.15)),
    )
    assert set(interactive(parsed(runner, scene))) == {"red_box"}


def test_what_lies_on_a_box_with_an_overhang_is_handled(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.1, 0.1, RED), factories.pose(0.0, 0.05)),
        (tabletops.box(0.1, 0.2, 0.04, WHITE), factories.pose(0.0, 0.0, 0.1, yaw=0.2)),
    )
    assert len(interactive(parsed(runner, scene))) == 2


def test_an_empty_table_is_refused(runner):
    with pytest.raises(RuleError, match="no object stands on the support") as caught:
        parsed(runner, tabletops.tabletop())
    assert caught.value.facts["points_above"].endswith("px over the support")
    assert caught.value.facts["threshold"].endswith("mm at the median depth")


def test_one_thing_on_an_empty_table_touches_nothing(runner):
    """Most of the depth is missing, and no two labels meet along a border."""
    scene = tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(0, 0, yaw=0.5)))
    missing = np.random.default_rng(0).random(scene.labels.labels.shape) < 0.8
    depth = np.where(missing, 0, scene.capture.measured.depth.depth)
    capture = factories.rgbd(scene.capture.photograph.rgb.pixels, depth, scene.capture.photograph.camera)
    support = runner.run("align.support", **factories.shot(capture))
    with pytest.raises(RuleError, match="no object stands on the support") as caught:
        runner.run("factorize.parse", **factories.shot(capture), support=support)
    assert "of the pixels, median 0." in caught.value.facts["depth"]


@pytest.mark.medium
def test_the_stub_needs_no_names(runner, three):
    found = interactive(parsed(runner, three, profile="stub"))
    assert set(found) == {"object", "object_2", "object_3"}
    assert all(element.box for element in found.values())


@pytest.mark.medium
def test_the_same_photograph_gives_the_same_bytes(runner, three):
    assert runner.encode(parsed(runner, three)) == runner.encode(parsed(runner, three))


@pytest.mark.medium
def test_a_scene_file_renames_by_words_and_by_box(runner, fine):
    left, top, right, bottom = interactive(parsed(runner, fine))["blue_cylinder"].box
    text = f"""
elements:
  - {{name: salad_bowl, phrase: a white bowl, material: plastic}}
  - name: can
    box: [{left - 3}, {top + 2}, {right + 2}, {bottom}]
    material: metal
"""
    elements = parsed(runner, fine, text)
    found = interactive(elements)
    assert set(found) == {"salad_bowl", "can"}
    assert found["salad_bowl"].category == "bowl"
    assert (found["salad_bowl"].material, found["salad_bowl"].material_confidence) == ("plastic", 1.0)
    assert found["can"].box == (left - 3, top + 2, right + 2, bottom)
    assert elements.source == "scene.yaml"
    unnamed = next(element for element in elements.elements if element.name == "red_box")
    assert not unnamed.interactive


def test_a_scene_file_may_call_a_thing_static(runner, three):
    text = "elements:\n- {name: vase, phrase: blue cylinder}\n- {name: stand, phrase: red box, category: support}\n"
    elements = parsed(runner, three, text).elements
    assert [element.name for element in elements if element.interactive] == ["vase"]


@pytest.mark.medium
def test_an_element_that_matches_nothing_lists_the_proposals(runner, fine):
    with pytest.raises(RuleError) as caught:
        parsed(runner, fine, "elements:\n  - name: vase\n    phrase: green vase\n")
    assert caught.value.message == "`vase` matches nothing that stands out from the support"
    assert str(caught.value.where) == "$scene:2:5"
    for name in ("red_box", "white_bowl", "blue_cylinder"):
        assert name in caught.value.facts["proposals"]


@pytest.mark.medium
def test_two_boxes_for_one_thing_are_refused(runner, three):
    box = list(interactive(parsed(runner, three))["red_box"].box)
    with pytest.raises(RuleError, match="`b` matches nothing"):
        parsed(runner, three, f"elements:\n- {{name: a, box: {box}}}\n- {{name: b, box: {box}}}\n")
