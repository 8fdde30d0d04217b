"""Objects are taken out by a pipeline of FLUX.2's classes with tiny random weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.scenes.scene import Background
from dextera_build.learning import flux2
from dextera_build.testing import RuleRunner
from rules.background.holes import hole
from rules.background.pieces import bordered
from rules.background.static_flux2 import Flux2Options
from tests.installed import needs
from tests.rules.background import tiny_flux2
from tests.rules.background.test_static import segmented, striped_table, with_box

needs("diffusers", "transformers")


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_flux2.save(tmp_path_factory.mktemp("flux2"))


def cleaned(tmp_path: Path, weights: Path, mask: np.ndarray | None = None, **options: Any) -> Background:
    empty, table = striped_table()
    capture, seen = with_box(empty, table)
    inputs = {"photograph": capture.photograph, "measured": capture.measured, "support": table}
    inputs["instances"] = segmented(seen if mask is None else mask)
    runner = RuleRunner(tmp_path, weights={"flux2_klein": weights})
    if not options:
        return runner.run("background.static", backend="planes", **inputs)
    return runner.run("background.static", backend="flux2", options={"flux2": options}, **inputs)


@pytest.mark.slow
def test_only_the_hole_is_painted_and_the_rest_is_that_of_planes(tmp_path: Path, weights: Path) -> None:
    painted, planes = cleaned(tmp_path, weights, steps=2, longest_px=128), cleaned(tmp_path, weights)
    empty, table = striped_table()
    taken = hole(segmented(with_box(empty, table)[1]), np.zeros((240, 320), bool), 0.025)
    assert (painted.image.pixels[~taken] == planes.image.pixels[~taken]).all()
    assert (painted.image.pixels[taken] != planes.image.pixels[taken]).any(axis=-1).mean() > 0.9
    assert np.array_equal(painted.depth.depth, planes.depth.depth)
    assert np.array_equal(painted.mesh.vertices, planes.mesh.vertices)
    assert painted.mesh.texture is not None
    assert np.array_equal(painted.mesh.texture.pixels, bordered(painted.image.pixels))
    assert painted.boxes == planes.boxes


@pytest.mark.slow
def test_the_seed_and_the_prompt_decide(tmp_path: Path, weights: Path) -> None:
    first, again, other, asked = (
        cleaned(tmp_path, weights, steps=2, longest_px=64, **more).image.pixels
        for more in ({"seed": 1}, {"seed": 1}, {"seed": 2}, {"seed": 1, "prompt": "a red carpet"})
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first, asked)


@pytest.mark.medium
def test_nothing_is_painted_where_nothing_is_taken_out(tmp_path: Path, weights: Path) -> None:
    nothing = np.zeros((240, 320), bool)
    painted, planes = cleaned(tmp_path, weights, nothing, steps=1), cleaned(tmp_path, weights, nothing)
    assert np.array_equal(painted.image.pixels, planes.image.pixels)


@pytest.mark.slow
def test_a_hole_smaller_than_a_cell_is_painted(weights: Path) -> None:
    pixels, taken = np.full((64, 64, 3), 120, np.uint8), np.zeros((64, 64), bool)
    taken[17:19, 17:19] = True
    pipeline = flux2.load(weights, "cpu")
    first, second = (
        flux2.paint(pipeline, pixels, taken, "a table", Flux2Options(steps=2, seed=seed), 64) for seed in (1, 2)
    )
    assert not np.array_equal(first[16:32, 16:32], second[16:32, 16:32])


def test_a_picture_of_any_size_keeps_it(weights: Path) -> None:
    taken = np.zeros((50, 70), bool)
    taken[10:30, 20:40] = True
    pixels = np.full((50, 70, 3), 120, np.uint8)
    painted = flux2.paint(flux2.load(weights, "cpu"), pixels, taken, "a table", Flux2Options(steps=1), 64)
    assert painted.shape == pixels.shape
    assert painted.dtype == np.uint8
