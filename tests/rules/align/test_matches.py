"""Points of two pictures: a picture and the same picture through a known homography."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.rules.align import matchers
from tests.rules.factorize.shapes import generators

cv2 = pytest.importorskip("cv2")
MODULES = {"xfeat": matchers.XFEAT, "disk_lightglue": matchers.LIGHTGLUE}
HEIGHT, WIDTH = 240, 320


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    (tmp_path / "scratch").mkdir()
    return RuleRunner(tmp_path / "scratch", project=tmp_path)


def pair() -> tuple[Image, Image, np.ndarray]:
    """Rectangles of random colours, the same seen obliquely and darker, and the homography between the pixels."""
    random = np.random.default_rng(0)
    pixels = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    for _ in range(120):
        left, top = (int(random.integers(0, most)) for most in (WIDTH, HEIGHT))
        right, bottom = (int(each + random.integers(6, 40)) for each in (left, top))
        cv2.rectangle(pixels, (left, top), (right, bottom), tuple(random.integers(0, 255, 3).tolist()), -1)
    corners = np.array([(0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (0, HEIGHT)], np.float32)
    moved = np.array([(25, 12), (310, 0), (320, 223), (0, 240)], np.float32)
    homography = cv2.getPerspectiveTransform(corners, moved)
    seen = cv2.warpPerspective(pixels, homography, (WIDTH, HEIGHT)) * 0.8
    return Image(pixels=pixels), Image(pixels=seen.astype(np.uint8)), homography


def within_3_px(found: Matches, homography: np.ndarray) -> float:
    true = cv2.perspectiveTransform(found.first[None], homography)[0]
    return float(np.mean(np.linalg.norm(true - found.second, axis=1) < 3.0))


@pytest.mark.medium
@pytest.mark.parametrize("backend", ["sift", *MODULES])
def test_most_pairs_show_the_same_place(tmp_path: Path, runner: RuleRunner, backend: str) -> None:
    if backend in MODULES:
        generators.environment(tmp_path, backend, MODULES[backend])
    first, second, homography = pair()
    found: Matches = runner.run("align.matches", backend=backend, first=first, second=second)
    assert len(found.first) > 50
    assert within_3_px(found, homography) > 0.8
    assert (np.diff(found.confidence) <= 0.0).all()
    assert runner.outcome.line == f"{len(found.first)} pairs by {found.method}"


def test_a_smaller_ratio_leaves_fewer_and_better_pairs(runner: RuleRunner) -> None:
    first, second, homography = pair()
    strict, lax = (
        runner.run("align.matches", backend="sift", options={"sift": {"ratio": ratio}}, first=first, second=second)
        for ratio in (0.5, 1.0)
    )
    assert len(strict.first) < len(lax.first)
    assert within_3_px(strict, homography) > within_3_px(lax, homography)
    assert strict.confidence.min() >= 0.5


@pytest.mark.parametrize("blank", ["first", "second"])
def test_a_picture_without_points_has_no_pairs(runner: RuleRunner, blank: str) -> None:
    pictures = dict(zip(("first", "second"), pair()[:2], strict=True))
    pictures[blank] = Image(pixels=np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    found = runner.run("align.matches", backend="sift", **pictures)
    assert len(found.first) == 0
    assert runner.outcome.line == "0 pairs by SIFT"


@pytest.mark.medium
def test_a_point_outside_its_picture_is_refused(tmp_path: Path, runner: RuleRunner) -> None:
    stand_in = matchers.SIFT.replace("point.pt for", "(point.pt[0] + 500, 0) for")
    generators.environment(tmp_path, "xfeat", {**matchers.XFEAT, "stand_in.py": stand_in})
    first, second, _ = pair()
    with pytest.raises(RuleError, match="a point is outside its picture"):
        runner.run("align.matches", backend="xfeat", first=first, second=second)


def test_the_stub_gives_points_of_both_pictures(runner: RuleRunner) -> None:
    first, second, _ = pair()
    found = runner.run("align.matches", backend="stub", first=first, second=second)
    assert len(found.first) == 9
