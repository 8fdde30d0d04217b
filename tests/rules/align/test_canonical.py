"""Canonical frames: openings, rest, handles and pictures decide; what they cannot tell is named."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.canonical import CanonicalFrame
from dextera_build.artifacts.objects.object import Placement
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, lie, registration, solids, transforms
from dextera_build.testing import RuleRunner
from tests import factories, object_views

MUG, BOWL = object_views.mesh(object_views.mug()), object_views.mesh(object_views.bowl())
BOX = object_views.mesh(solids.box((0.12, 0.06, 0.08), (0.0, 0.0, 0.04)))
Z, X = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def canonical(runner, mesh, turn=None, **inputs) -> CanonicalFrame:
    rotation = np.eye(3) if turn is None else turn
    moved = mesh.model_copy(update={"vertices": (mesh.vertices @ rotation.T).astype(np.float32)})
    found = runner.run("align.canonical", body=object_views.body(moved), **inputs)
    assert isinstance(found, CanonicalFrame)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 5, 11, 16, 23])
def test_a_mug_is_open_upwards_and_its_handle_is_in_front_in_every_frame(runner, number):
    turn = registration.cube_rotations()[number]
    frame = canonical(runner, MUG, turn)
    assert frame.pose.matrix[:3, :3] @ turn @ Z == pytest.approx(Z, abs=1e-9)
    assert frame.pose.matrix[:3, :3] @ turn @ X == pytest.approx(X, abs=1e-9)
    assert frame.undecided == ()
    assert frame.symmetry == ()
    corners = transforms.apply(frame.pose.matrix, MUG.vertices @ turn.T)
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-6)


def test_a_bowl_has_no_front(runner):
    frame = canonical(runner, BOWL, registration.cube_rotations()[7])
    assert frame.pose.matrix[:3, :3] @ registration.cube_rotations()[7] @ Z == pytest.approx(Z, abs=1e-9)
    assert frame.undecided == ("front",)
    (axis,) = frame.symmetry
    assert axis.order == 0
    assert "symmetry: round" in runner.outcome.line


def test_a_plain_box_is_not_guessed(runner):
    frame = canonical(runner, BOX)
    assert frame.undecided == ("up", "front")
    assert sorted(axis.order for axis in frame.symmetry) == [2, 2, 2]


@pytest.mark.medium
def test_the_photograph_tells_how_a_box_stands_unless_it_stands_on_an_edge(runner):
    lying = transforms.rigid(lie.rotation(np.array([np.pi / 2, 0.0, 0.0])), np.zeros(3))
    placement = Placement(pose=factories.placed(lying), scale=1.0, method="test")
    frame = canonical(runner, BOX, placement=placement)
    assert frame.pose.matrix[:3, :3] @ np.array([0.0, 1.0, 0.0]) == pytest.approx(Z, abs=1e-9)
    assert frame.undecided == ("front",)
    tipped = transforms.rigid(lie.rotation(np.array([np.pi / 4, 0.0, 0.0])), np.zeros(3))
    placement = Placement(pose=factories.placed(tipped), scale=1.0, method="test")
    assert "up" in canonical(runner, BOX, placement=placement).undecided


def test_a_laptop_is_brought_into_its_frame_with_its_hinge(runner):
    made = factories.laptop_asset()
    frame = runner.run("align.canonical", body=made.body)
    moved = similar.body(made.body, frame.motion())
    points = kinematics.posed_surface(moved)[0]
    assert points == pytest.approx(
        transforms.apply(frame.pose.matrix, kinematics.posed_surface(made.body)[0]), abs=1e-6
    )


def test_the_stub_decides_nothing(tmp_path):
    frame = RuleRunner(tmp_path).run("align.canonical", backend="stub", body=object_views.body(MUG))
    assert frame.undecided == ("up", "front")


def named(folder, says: str) -> CanonicalFrame:
    from tests.rules.factorize.elements import tiny_qwen3_vl

    weights = tiny_qwen3_vl.save(folder / "weights", says)
    runner = RuleRunner(folder, weights={"qwen3_vl": weights})
    found = runner.run(
        "align.canonical", backend="qwen3_vl", options={"qwen3_vl": {"picture_tokens": 16}}, body=object_views.body(MUG)
    )
    assert isinstance(found, CanonicalFrame)
    return found


@pytest.mark.slow
def test_a_language_model_names_one_of_the_pictures(tmp_path):
    pytest.importorskip("transformers")
    frame = named(tmp_path, "3")
    assert frame.pose.matrix[2, :3] == pytest.approx([0.0, 1.0, 0.0])
    assert frame.undecided == ()
    assert "Qwen3-VL" in frame.method


@pytest.mark.slow
def test_a_language_model_that_cannot_tell_leaves_both_open(tmp_path):
    pytest.importorskip("transformers")
    assert named(tmp_path, "0").undecided == ("up", "front")


@pytest.mark.medium
def test_a_language_model_that_names_no_number_is_an_error(tmp_path):
    pytest.importorskip("transformers")
    with pytest.raises(RuleError, match="names no number from 0 to 6") as caught:
        named(tmp_path, "the red one")
    assert "geometry" in caught.value.hint
