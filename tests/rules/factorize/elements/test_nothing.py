"""Where no object is found, the error says why."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories, tabletops

BOX = tabletops.box(0.12, 0.1, 0.12, (0.8, 0.2, 0.2))


def error_of(tmp_path, capture: Capture) -> RuleError:
    runner = RuleRunner(tmp_path)
    support = runner.run("align.support", **factories.shot(capture))
    with pytest.raises(RuleError, match="no object stands on the support") as caught:
        runner.run("factorize.parse", **factories.shot(capture), support=support)
    return caught.value


def with_depth(capture: Capture, depth: np.ndarray) -> Capture:
    return factories.rgbd(capture.photograph.rgb.pixels, depth.astype(np.float32), capture.photograph.camera)


@pytest.mark.medium
def test_an_object_without_depth_is_suspected_where_the_depth_is_missing(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose()))
    assert scene.capture.measured is not None
    blind = np.where(scene.labels.labels > 0, 0.0, scene.capture.measured.depth.depth)
    error = error_of(tmp_path, with_depth(scene.capture, blind))
    rows, columns = np.nonzero(scene.labels.labels)
    assert "a region of the support has no depth, box [" in error.message
    left, top, right, bottom = (
        int(word.strip(" ,;]"))
        for word in error.message.split("box [")[1].split(",")[:4]
        for word in [word.split("]")[0]]
    )
    assert left <= np.median(columns) <= right
    assert top <= np.median(rows) <= bottom


@pytest.mark.medium
def test_a_thing_cut_by_the_border_is_told_from_an_empty_table(tmp_path):
    cut = tabletops.tabletop((BOX, factories.pose(0.43, 0.0)))
    assert cut.labels.labels[:, -1].any()
    assert "the border of the picture cuts the thing" in error_of(tmp_path, cut.capture).message
    empty = tabletops.tabletop((tabletops.box(0.1, 0.1, 0.002, (0.8, 0.2, 0.2)), factories.pose()))
    assert "nothing is higher than the noise" in error_of(tmp_path, empty.capture).message


@pytest.mark.medium
def test_a_wall_seen_frontally_is_suspected(tmp_path):
    wall = factories.box_mesh((-3, 0.8, -3), (3, 0.9, 3))
    eye = factories.look_at((0.0, -0.3, 0.2), (0.0, 0.8, 0.2))
    scene = tabletops.tabletop((wall, factories.pose()), eye=eye, half=0.001)
    assert "seen frontally, as a wall is" in error_of(tmp_path, scene.capture).message


@pytest.mark.medium
def test_a_unit_that_is_ten_times_too_large_is_suspected(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose()))
    assert scene.capture.measured is not None
    far = np.minimum(scene.capture.measured.depth.depth * 5, 19.0)
    runner = RuleRunner(tmp_path)
    shot = factories.shot(with_depth(scene.capture, far))
    support = runner.run("align.support", **shot, options={"farthest_m": 20.0})
    scenery = RuleRunner(tmp_path)
    with pytest.raises(RuleError) as caught:
        scenery.run("factorize.parse", **shot, support=support)
    assert "m below the camera, where noise hides lower things" in str(caught.value.message) + str(caught.value.facts)
    assert "depth_scale_m" in (caught.value.hint or "")


@pytest.mark.slow
def test_depth_that_is_noise_is_called_so(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose()), lens=tabletops.FINE)
    noise = np.random.default_rng(2).uniform(0.4, 1.2, scene.labels.labels.shape)
    error = error_of(tmp_path, with_depth(scene.capture, noise))
    assert "the depth is noise: neighbouring pixels differ by 2" in error.message
    assert "order of bytes" in (error.hint or "")


@pytest.mark.medium
def test_a_unit_that_is_too_small_is_suspected(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose()))
    assert scene.capture.measured is not None
    error = error_of(tmp_path, with_depth(scene.capture, scene.capture.measured.depth.depth * 0.15))
    assert re.search("the support is only [0-9]+ cm below the camera", error.message)
    assert "`depth_scale_m`" in (error.hint or "")


@pytest.mark.medium
def test_an_object_cut_together_with_the_support_beneath_it_is_told(tmp_path):
    """Where the lower border cuts the object, nothing of it stands over the support that is seen."""
    scene = tabletops.tabletop(
        (tabletops.box(0.12, 0.12, 0.12, (0.8, 0.2, 0.2)), factories.pose(0.0, -0.1)), lens=tabletops.FINE
    )
    top = int(np.nonzero(scene.labels.labels)[0].min())
    photo, measured = scene.capture.photograph, scene.capture.measured
    assert measured is not None
    rows = top + 40
    lens = photo.camera.crop(0, 0, photo.camera.width, rows)
    cut = factories.rgbd(photo.rgb.pixels[:rows].copy(), measured.depth.depth[:rows].copy(), lens)
    assert "the border of the picture cuts" in error_of(tmp_path, cut).message


@pytest.mark.medium
def test_dropout_of_half_of_the_depth_is_filled(tmp_path):
    scene = tabletops.tabletop((BOX, factories.pose()))
    assert scene.capture.measured is not None
    keep = np.random.default_rng(0).random(scene.labels.labels.shape) > 0.5
    capture = with_depth(scene.capture, np.where(keep, scene.capture.measured.depth.depth, 0.0))
    runner = RuleRunner(tmp_path)
    shot = factories.shot(capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    found = runner.run("factorize.segment", **shot, support=support, elements=elements)
    assert tabletops.iou(found.map.labels == 1, scene.labels.labels == 1) > 0.9
