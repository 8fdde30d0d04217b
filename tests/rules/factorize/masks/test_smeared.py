"""What cannot become a body stays in the background, and the other objects are made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.factorize.masks import smeared
from tests import factories, tabletops

BOX = tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2))


def segmented(runner: RuleRunner, capture: Capture):
    shot = factories.shot(capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    return runner.run("factorize.segment", **shot, support=support, elements=elements)


def with_smear(scene: tabletops.Tabletop) -> Capture:
    """A blue strip whose depth runs along the lines of sight, as between two surfaces."""
    assert scene.capture.measured is not None
    depth = scene.capture.measured.depth.depth.copy()
    strip = depth[285:325, 430:452]
    strip *= 1.0 - np.linspace(0.03, 0.18, strip.shape[1], dtype=np.float32)
    pixels = scene.capture.photograph.rgb.pixels.copy()
    pixels[285:325, 430:452] = (40, 60, 150)
    return factories.rgbd(pixels, depth, scene.capture.photograph.camera)


@pytest.mark.slow
def test_a_smear_stays_in_the_background_with_a_warning(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose(-0.1, 0.0, yaw=0.4)), lens=tabletops.FINE)
    runner = RuleRunner(tmp_path)
    found = segmented(runner, with_smear(scene))
    assert len(found.names) == 1
    assert tabletops.iou(found.map.labels == 1, scene.labels.labels == 1) > 0.9
    (warning,) = runner.outcome.warnings
    assert "stays in the background: " in warning
    assert found.map.fixed[290:320, 436:450].mean() > 0.5, "it is a thing that is no object"


@pytest.mark.medium
def test_a_body_of_few_pixels_is_no_smear(tmp_path):
    # Along the outline, where depth is smeared and never trusted, lies a third of its pixels.
    small = tabletops.cylinder(0.03, 0.065, (0.8, 0.2, 0.2))
    lens = Camera(width=320, height=240, fx=290.0, fy=290.0, cx=158.0, cy=121.5)
    photo = tabletops.tabletop((small, factories.pose()), lens=lens).capture
    assert photo.measured is not None
    depth = ndimage.uniform_filter(photo.measured.depth.depth, 5)
    pixels = ndimage.uniform_filter(photo.photograph.rgb.pixels, (3, 3, 1))
    found = segmented(RuleRunner(tmp_path), factories.rgbd(pixels, depth, lens))
    assert len(found.names) == 1


@pytest.mark.slow
def test_if_nothing_can_become_a_body_each_reason_is_told(tmp_path):
    scene = tabletops.tabletop((tabletops.box(0.1, 0.1, 0.002, (0.8, 0.2, 0.2)), factories.pose()), lens=tabletops.FINE)
    with pytest.raises(RuleError, match="no segmented object yields a valid body") as caught:
        segmented(RuleRunner(tmp_path), with_smear(scene))
    assert "depth" in str(caught.value.facts["objects"])


@pytest.mark.parametrize(("factor", "word"), [(0.12, "smaller"), (8.0, "larger")])
def test_sizes_that_no_hand_takes_are_doubted(factor, word):
    sizes = {"a": 0.12 * factor, "b": 0.2 * factor}
    assert f"every object is {word} than" in smeared.odd_scale(sizes)
    assert not smeared.odd_scale({**sizes, "c": 0.1})
