"""Views of objects that something nearer hides are completed, and only there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.view import MeasuredView, ObjectView, Seen
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.factorize.masks import mirror
from rules.factorize.masks.complete import hidden_part
from rules.factorize.masks.complete_flux2 import whole
from tests import factories
from tests.rules.background import tiny_flux2

ROWS, COLUMNS = np.mgrid[:96, :128]
ELLIPSE = ((COLUMNS - 64) / 40.0) ** 2 + ((ROWS - 48) / 24.0) ** 2 <= 1.0
BAR = (COLUMNS > 60) & (COLUMNS < 80)
CORNER = (COLUMNS > 80) & (ROWS < 60)


def picture(hidden: np.ndarray, seed: int = 0) -> np.ndarray:
    """A red ellipse on a grey table behind something blue, with noise; the object's truth is `ELLIPSE`."""
    colours = np.where(ELLIPSE[..., None], (190, 50, 40), (150, 150, 140))
    colours = np.where(hidden[..., None], (40, 60, 170), colours)
    return np.clip(colours + np.random.default_rng(seed).normal(0, 6, colours.shape), 0, 255).astype(np.uint8)


def view(hidden: np.ndarray) -> ObjectView:
    lens = Camera(width=128, height=96, fx=150.0, fy=150.0, cx=63.5, cy=47.5)
    pixels = Image(pixels=picture(hidden))
    return ObjectView(rgb=pixels, mask=ELLIPSE & ~hidden, occluder=hidden, camera=lens, phrase="red plate")


def same(first: ObjectView, second: ObjectView) -> bool:
    pairs = [(getattr(first, name), getattr(second, name)) for name in ("mask", "occluder")]
    return all(np.array_equal(*pair) for pair in pairs) and np.array_equal(first.rgb.pixels, second.rgb.pixels)


def iou(first: np.ndarray, second: np.ndarray) -> float:
    return float((first & second).sum() / (first | second).sum())


@pytest.mark.parametrize("hidden", [BAR, CORNER], ids=["a bar through the middle", "one end"])
@pytest.mark.parametrize("quarters", [0, 1])
def test_symmetry_completes_mask_and_colours(tmp_path: Path, hidden: np.ndarray, quarters: int) -> None:
    level = view(hidden)
    turned = [np.ascontiguousarray(np.rot90(x, quarters)) for x in (level.rgb.pixels, level.mask, level.occluder)]
    seen = level.model_copy(
        update={"rgb": Image(pixels=turned[0]), "mask": turned[1], "occluder": turned[2]}
        | ({"camera": level.camera.turned(quarters)} if quarters else {})
    )
    found = RuleRunner(tmp_path).run("factorize.complete", backend="mirrored", view=seen)
    truth = np.rot90(ELLIPSE, quarters)
    assert iou(seen.mask, truth) < 0.8
    assert iou(found.mask, truth) > 0.9
    added = found.rgb.pixels[found.mask & ~seen.mask].astype(float).mean(axis=0)
    assert np.abs(added - (190, 50, 40)).max() < 15


def test_a_line_that_mirrors_the_mask_onto_what_is_seen_is_none() -> None:
    """An L has no line of symmetry that the picture does not speak against."""
    bent = np.zeros((96, 128), bool)
    bent[10:80, 20:40] = True
    bent[60:80, 20:110] = True
    assert mirror.best_line(bent, np.zeros_like(bent), 24, 0.03, 0.5, 96) is None


def test_convexity_fills_between_visible_parts_only_where_something_hides() -> None:
    both = ELLIPSE & ~BAR
    assert iou(mirror.convex(both), ELLIPSE) > 0.98


@pytest.mark.parametrize("hidden", [BAR, CORNER], ids=["a bar through the middle", "one end"])
@pytest.mark.parametrize("seed", range(3))
def test_a_perfect_painting_gives_the_true_mask(hidden: np.ndarray, seed: int) -> None:
    seen = ELLIPSE & ~hidden
    found = whole(picture(np.zeros_like(hidden), seed), seen, hidden, 5)
    assert iou(seen, ELLIPSE) < 0.8
    assert iou(found, ELLIPSE) > 0.97
    assert found[seen].all()
    assert not (found & ~seen & ~hidden).any()


def test_a_painting_of_the_table_adds_nothing() -> None:
    painted = picture(np.zeros_like(CORNER))
    painted[CORNER] = (150, 150, 140)
    found = whole(painted, ELLIPSE & ~CORNER, CORNER, 5)
    assert (found & CORNER).sum() < 0.02 * (ELLIPSE & CORNER).sum()


def test_without_surroundings_there_is_nothing_to_cut_from() -> None:
    assert np.array_equal(whole(picture(BAR), ~BAR, BAR, 5), ~BAR)


@pytest.mark.medium
@given(shift=st.integers(0, 7))
def test_the_hidden_part_of_an_outline(shift: int) -> None:
    square = (abs(ROWS - 48) < 10) & (abs(COLUMNS - 64) < 10)
    beside = np.greater_equal(COLUMNS, 74 + shift)  # one of four sides, if it touches
    assert hidden_part(square, beside & ~square) == pytest.approx(0.25 if shift == 0 else 0.0, abs=0.02)


def test_a_view_that_little_hides_is_the_same(tmp_path: Path) -> None:
    free = view(np.zeros_like(BAR))
    out = RuleRunner(tmp_path).run("factorize.complete", backend="visible", view=free)
    assert same(out, free)
    hidden = view(BAR)
    assert same(RuleRunner(tmp_path).run("factorize.complete", backend="visible", view=hidden), hidden)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("diffusers")
    pytest.importorskip("transformers")
    return tiny_flux2.save(tmp_path_factory.mktemp("flux2"))


def completed(tmp_path: Path, weights: Path, seen: ObjectView, **options: Any) -> ObjectView:
    runner = RuleRunner(tmp_path, weights={"flux2_klein": weights})
    made: ObjectView = runner.run(
        "factorize.complete", backend="flux2", view=seen, options={"flux2": {"steps": 2, "longest_px": 128, **options}}
    )
    return made


@pytest.mark.slow
def test_flux2_paints_behind_the_occluder_only(tmp_path: Path, weights: Path) -> None:
    seen = view(BAR)
    made = completed(tmp_path, weights, seen)
    assert made.mask[seen.mask].all()
    added = made.mask & ~seen.mask
    assert not (added & ~seen.occluder).any()
    assert np.array_equal(made.rgb.pixels[~added], seen.rgb.pixels[~added])
    assert np.array_equal(made.occluder, seen.occluder)
    assert same(made, completed(tmp_path, weights, seen))


def test_flux2_is_not_asked_about_what_is_in_full_view(tmp_path: Path, weights: Path) -> None:
    free = view((COLUMNS > 120) & (ROWS < 5))
    runner = RuleRunner(tmp_path, weights={"flux2_klein": weights})
    assert same(runner.run("factorize.complete", backend="flux2", view=free), free)
    assert "visible part only" in runner.outcome.line


BREAKS = {
    "changes visible pixels": "np.zeros_like(view.rgb.pixels), view.mask",
    "grew where nothing hides": "view.rgb.pixels, np.ones_like(view.mask)",
    "another size": "view.rgb.pixels[:-1], view.mask[:-1]",
}


@pytest.mark.parametrize("message", BREAKS)
def test_a_backend_that_breaks_a_promise_is_told(tmp_path: Path, message: str) -> None:
    project = tmp_path / "project"
    file = project / "rules" / "factorize" / "complete_bad.py"
    file.parent.mkdir(parents=True)
    file.write_text(
        '"""A backend."""\nimport numpy as np\n\nfrom dextera_build.rule import Backend, Options\n\n'
        'BACKEND = Backend(summary="bad", packages=("numpy",))\n\n\ndef complete(ctx, view, options: Options):\n'
        f'    """Wrong."""\n    return {BREAKS[message]}\n'
    )
    with pytest.raises(RuleError, match=message):
        RuleRunner(tmp_path, project).run("factorize.complete", backend="bad", view=view(BAR))


def test_depth_of_the_nearer_thing_is_not_the_objects() -> None:
    depth = DepthImage(depth=np.where(BAR, 0.4, 0.8).astype(np.float32))
    measured = MeasuredView(depth=depth, camera_pose=factories.placed(np.eye(4), "camera"))
    seen = view(BAR)
    assert np.array_equal(Seen(seen, measured).depth, depth.depth)
    whole_view = seen.model_copy(update={"mask": ELLIPSE})
    assert (Seen(whole_view, measured).depth[ELLIPSE & BAR] == 0.0).all()
    assert (Seen(whole_view, measured).depth[ELLIPSE & ~BAR] > 0.7).all()
