"""Placement: good guesses stay, bad ones are repaired, unknown scale and orientation are found, nonsense is refused."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, metrics, solids, transforms
from dextera_build.testing import RuleRunner
from tests import factories, object_views

TRUTH = factories.pose(0.02, 0.03, 0.0, 0.6)
BOX = object_views.mesh(solids.box((0.12, 0.06, 0.08), (0.0, 0.0, 0.04)))
BRACKET = object_views.mesh(object_views.bracket())


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def align(runner, body: Body, seen, **options) -> Placement:
    found = runner.run("align.object", body=body, **object_views.sights(seen), options=options)
    assert isinstance(found, Placement)
    return found


def worst(mesh, placed: Placement, truth=TRUTH) -> float:
    """Largest distance of a vertex from its true place [m]."""
    vertices = mesh.vertices.astype(np.float64)
    found = transforms.apply(placed.pose.matrix, placed.scale * vertices)
    return float(np.linalg.norm(found - transforms.apply(truth, vertices), axis=1).max())


@pytest.mark.parametrize("mesh", [BOX, BRACKET])
def test_a_good_guess_is_kept_to_the_last_bit(runner, mesh):
    seen = object_views.view(mesh, TRUTH, noise_m=0.0015)
    placed = align(runner, object_views.body(mesh, TRUTH), seen)
    assert placed.scale == 1.0
    assert (placed.pose.matrix == TRUTH).all()
    assert placed.method.startswith("guess kept")
    assert placed.overlap > 0.99
    assert placed.residual_m < 0.0015


@pytest.mark.parametrize("mesh", [BOX, BRACKET])
def test_a_guess_that_is_off_is_repaired_at_scale_one(runner, mesh):
    seen = object_views.view(mesh, TRUTH, noise_m=0.0015)
    off = factories.pose(0.028, 0.024, 0.0, 0.7)
    placed = align(runner, object_views.body(mesh, off), seen)
    assert placed.method.startswith("guess refined")
    assert placed.scale == pytest.approx(1.0, abs=0.003)
    assert worst(mesh, placed) < 0.003
    assert placed.pose.matrix[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_an_occluder_does_not_pull_the_box_to_the_part_that_is_seen(runner):
    hidden = np.zeros((240, 320), bool)
    hidden[:, 172:] = True
    seen = object_views.view(BOX, TRUTH, noise_m=0.0015, hidden=hidden)
    assert seen.view.mask.sum() < 0.75 * object_views.view(BOX, TRUTH).view.mask.sum()
    placed = align(runner, object_views.body(BOX, factories.pose(0.026, 0.026, 0.0, 0.66)), seen)
    assert placed.scale == pytest.approx(1.0, abs=0.003)
    assert worst(BOX, placed) < 0.006


@pytest.mark.medium
def test_a_poor_guess_that_nothing_beats_clearly_is_kept(runner):
    seen = object_views.view(BRACKET, TRUTH)
    poor = factories.pose(0.035, 0.04, 0.0, 0.6)
    placed = align(runner, object_views.body(BRACKET, poor), seen, icp={"search_gain": 2.0, "guess_iou": 0.9})
    assert (placed.pose.matrix == poor).all()
    assert placed.method.startswith("guess kept (IoU 0.")
    assert placed.method.endswith("gained too little)")


@pytest.mark.medium
@pytest.mark.parametrize(
    ("scale", "turn"), [(0.1, (0.0, 0.0, 0.0)), (10.0, (1.5708, 0.0, 0.0)), (3.0, (0.5, 1.1, -0.7))]
)
def test_unknown_scale_and_orientation_are_found(runner, scale, turn):
    rotation = lie.rotation(np.array(turn))
    moved = (BRACKET.vertices @ rotation.T * scale).astype(np.float32)
    canonical = BRACKET.model_copy(update={"vertices": moved})
    seen = object_views.view(BRACKET, TRUTH, noise_m=0.0015)
    placed = align(runner, object_views.body(canonical), seen)
    assert placed.scale * scale == pytest.approx(1.0, abs=0.02)
    found = transforms.apply(placed.pose.matrix, placed.scale * canonical.vertices.astype(np.float64))
    points = metrics.sample_surface(found, BRACKET.faces, 20000, 0)
    truth = metrics.sample_surface(transforms.apply(TRUTH, BRACKET.vertices), BRACKET.faces, 20000, 1)
    chamfer, within = metrics.chamfer_and_f(points, truth, 0.005)
    assert within > 0.99
    assert chamfer < 0.003
    assert "of 744 starts" in placed.method
    assert found[:, 2].min() == pytest.approx(0.0, abs=0.002)


@pytest.mark.medium
def test_a_handle_decides_the_turn_of_a_mug_of_unknown_size(runner):
    mug = object_views.mesh(object_views.mug())
    large = mug.model_copy(update={"vertices": mug.vertices * np.float32(7.0)})
    seen = object_views.view(mug, TRUTH, noise_m=0.0015)
    placed = align(runner, object_views.body(large), seen)
    assert placed.scale * 7.0 == pytest.approx(1.0, abs=0.02)
    handle = transforms.apply(placed.pose.matrix, placed.scale * np.array([[0.49, 0.0, 0.315]]))[0]
    assert np.linalg.norm(handle - transforms.apply(TRUTH, np.array([[0.07, 0.0, 0.045]]))[0]) < 0.006
    assert not placed.ambiguous


def test_what_nearly_touches_the_support_is_set_down(runner):
    seen = object_views.view(BOX, TRUTH)
    placed = align(runner, object_views.body(BOX, factories.pose(0.02, 0.03, 0.002, 0.6)), seen, icp={"gain": 1.0})
    assert worst(BOX, placed) < 1e-6
    assert placed.method.endswith("set down by 2.0 mm")


def test_what_stands_on_something_else_stays_there(runner):
    high = factories.pose(0.02, 0.03, 0.06, 0.6)
    placed = align(runner, object_views.body(BOX, high), object_views.view(BOX, high, noise_m=0.001))
    assert worst(BOX, placed, high) < 0.003
    assert placed.method.endswith("stands 60 mm above the support")


def test_what_is_seen_above_the_support_is_not_pushed_down(runner):
    high = factories.pose(0.02, 0.03, 0.012, 0.6)
    placed = align(runner, object_views.body(BOX, high), object_views.view(BOX, high))
    assert worst(BOX, placed, high) < 0.002
    assert placed.method.endswith("seen 12 mm above the support")


@pytest.mark.parametrize(("name", "round_"), [("bowl", True), ("mug", False), ("bracket", False)])
def test_only_round_bodies_are_ambiguous(runner, name, round_):
    mesh = object_views.mesh(getattr(object_views, name)())
    placed = align(runner, object_views.body(mesh, TRUTH), object_views.view(mesh, TRUTH))
    assert placed.ambiguous is round_
    assert ("turn undetermined" in runner.outcome.line) is round_


def test_a_laptop_is_placed_as_its_hinge_stands(runner):
    made = factories.laptop_asset(factories.pose(0.0, 0.0, 0.0, 0.2), opening=1.9)
    whole, _ = object_views.laptop(1.9)
    seen = object_views.view(object_views.mesh(whole), made.pose.matrix, category="laptop")
    placed = align(runner, made.body, seen)
    assert runner.outcome.metrics["mask_iou"][0] > 0.9
    assert placed.overlap > 0.9


def test_a_view_without_depth_is_refused(runner):
    seen = object_views.view(BOX, TRUTH)
    blind = object_views.changed(seen, depth=np.zeros(seen.view.mask.shape, np.float32))
    with pytest.raises(RuleError, match="only 0 pixels of the object have depth"):
        align(runner, object_views.body(BOX, TRUTH), blind)


@pytest.mark.slow
def test_a_placement_that_misses_the_mask_is_refused(runner):
    seen = object_views.view(BOX, TRUTH)
    moved = object_views.changed(seen, mask=np.roll(seen.view.mask, 6, axis=1))
    fitted = object_views.body(BOX, TRUTH)
    with pytest.raises(RuleError, match=r"covers the mask with IoU 0\.\d\d, 0\.99 is needed"):
        align(runner, fitted.model_copy(update={"pose": None}), moved, least_iou=0.99)
    align(runner, fitted, moved, least_iou=0.99)
    assert "covers the mask with IoU 0." in runner.outcome.warnings[0], "one bad shape does not cost the scene"


@pytest.mark.slow
def test_a_placement_in_free_space_is_refused(runner):
    seen = object_views.view(BOX, TRUTH)
    rows, columns = np.nonzero(seen.view.mask)
    depth = seen.measured.depth.depth.copy()
    # A window in the middle of the box through which the camera looked.
    depth[int(rows.mean()) - 8 : int(rows.mean()) + 8, int(columns.mean()) - 8 : int(columns.mean()) + 8] += 0.1
    holed = object_views.changed(seen, depth=depth)
    fitted = object_views.body(BOX, TRUTH)
    with pytest.raises(RuleError, match=r"\d+% of the placed render is in free space, 2% is allowed"):
        align(runner, fitted.model_copy(update={"pose": None}), holed, most_violation=0.02)
    align(runner, fitted, holed, most_violation=0.02)
    assert "of the placed render is in free space" in runner.outcome.warnings[0]


def test_the_same_input_gives_the_same_bytes(runner):
    seen = object_views.view(BRACKET, TRUTH, noise_m=0.0015)
    body = object_views.body(BRACKET, factories.pose(0.028, 0.024, 0.0, 0.7))
    assert runner.encode(align(runner, body, seen)) == runner.encode(align(runner, body, seen))
    assert len(runner.outcome.previews) == 1


def test_the_stub_believes_the_guess(runner):
    seen = object_views.view(BOX, TRUTH)
    placed = runner.run("align.object", body=object_views.body(BOX, TRUTH), **object_views.sights(seen), backend="stub")
    assert (placed.pose.matrix == TRUTH).all()
    assert placed.scale == 1.0
    assert runner.outcome.previews == []
