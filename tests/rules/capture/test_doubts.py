"""Captures that can be built, but are probably not what they say, are built with a warning."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.capture import registered
from tests import factories, tabletops

CAPTURES = Path(__file__).parents[4] / "shared" / "captures"


@pytest.fixture(scope="module")
def scene() -> tabletops.Tabletop:
    return tabletops.tabletop(
        (tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2)), factories.pose(-0.15, 0.05, yaw=0.4)),
        (tabletops.cylinder(0.05, 0.12, (0.2, 0.5, 0.8)), factories.pose(0.1, 0.05)),
        half=0.35,
        lens=tabletops.FINE,
    )


def warnings(tmp_path, scene, depth=None, scale: float = 0.001, **changes: float) -> list[str]:
    """Warnings of capture.folder about the scene with changed intrinsics or depth counts."""
    assert scene.capture.measured is not None
    counts = np.round(scene.capture.measured.depth.depth * 1000).astype(np.uint16) if depth is None else depth
    lens = tabletops.FINE.model_dump()
    told = {
        **{key: lens[key] for key in ("width", "height", "fx", "fy", "cx", "cy")},
        "depth_scale_m": scale,
        **changes,
    }
    found = {"rgb.png": png(scene.capture.photograph.rgb.pixels), "depth.png": png(counts)}
    runner = RuleRunner(tmp_path)
    runner.run("capture.folder", folder=Folder(files={**found, "capture.json": json.dumps(told).encode()}))
    return runner.outcome.warnings


def test_a_good_capture_is_not_doubted(tmp_path, scene):
    assert warnings(tmp_path, scene) == []


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"fx": 290.0}, "differ by 50%, but pixels are square"),
        ({"fx": 1160.0, "fy": 1160.0}, "field of view of 31 deg"),
        ({"fx": 145.0, "fy": 145.0}, "field of view of 131 deg"),
        ({"cx": 130.0}, "far from the middle"),
    ],
)
def test_odd_intrinsics_are_doubted(tmp_path, scene, changes, word):
    found = warnings(tmp_path, scene, **changes)
    assert any(word in text for text in found), found


@pytest.mark.parametrize(("scale", "word"), [(0.01, "too large"), (0.00015, "too small")])
def test_a_unit_that_no_table_has_is_doubted(tmp_path, scene, scale, word):
    found = warnings(tmp_path, scene, scale=scale)
    assert any(f"`depth_scale_m` {scale:g} may be {word}" in text for text in found), found


def test_a_depth_of_8_bit_is_called_so(tmp_path, scene):
    depth = np.clip(scene.capture.measured.depth.depth * 100, 0, 255).astype(np.uint8)
    assert any("has 8 bit, so its depths are steps of 10 mm" in text for text in warnings(tmp_path, scene, depth, 0.01))
    with pytest.raises(RuleError, match="unit is not plausible") as caught:
        warnings(tmp_path, scene, depth, 0.0001)
    assert caught.value.facts["bits"] == "8, which hold 255 depths at most"
    assert "with 16 bit" in (caught.value.hint or "")


@pytest.mark.medium
def test_8_bit_is_told_at_any_step_and_also_in_16_bit(tmp_path, scene):
    metres = np.clip(scene.capture.measured.depth.depth, 0, 0.89)
    assert any("has 8 bit" in text for text in warnings(tmp_path, scene, (metres / 0.0035).astype(np.uint8), 0.0035))
    stretched = (metres / 0.0035).astype(np.uint16) * 257
    found = warnings(tmp_path, scene, stretched, 0.0035 / 257)
    assert any("are steps of 3.5 mm: was it reduced to 8 bit?" in text for text in found), found


@pytest.mark.medium
def test_noise_is_called_so(tmp_path, scene):
    noise = np.random.default_rng(2).integers(400, 1200, scene.labels.labels.shape).astype(np.uint16)
    assert any("which is noise" in text for text in warnings(tmp_path, scene, noise))
    assert not any(
        "which is noise" in text for text in warnings(tmp_path, tabletops.tabletop(noise=3.0, lens=tabletops.FINE))
    )


def test_holes_in_the_depth_are_told(tmp_path, scene):
    counts = np.round(scene.capture.measured.depth.depth * 1000).astype(np.uint16)
    rows, columns = np.indices(counts.shape)
    counts[(rows // 24 % 2 == 0) & (columns // 24 % 2 == 0)] = 0
    assert any("of the depth is missing amid measured pixels" in text for text in warnings(tmp_path, scene, counts))


@pytest.mark.parametrize("move", [(12, 0), (-20, 6), (0, 15), (30, -9)])
def test_depth_that_is_not_registered_is_measured(tmp_path, scene, move):
    depth = np.round(np.roll(scene.capture.measured.depth.depth, move[::-1], axis=(0, 1)) * 1000).astype(np.uint16)
    assert any("register the depth" in text for text in warnings(tmp_path, scene, depth))
    found = registered.shift(scene.capture.photograph.rgb.pixels, depth / 1000.0)
    assert found is not None
    assert np.abs(np.array(found) - move).max() <= 2


def test_a_grey_picture_tells_nothing(scene):
    grey = np.full_like(scene.capture.photograph.rgb.pixels, 128)
    assert registered.shift(grey, np.roll(scene.capture.measured.depth.depth, 30, axis=1)) is None


@pytest.mark.parametrize(
    "name", ["table_blue_mug", "table_cheezit", "table_sugar", "table_top_5", "clutter_learn_05", "kitchen_table"]
)
def test_real_captures_are_not_doubted(tmp_path, name):
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    runner = RuleRunner(tmp_path)
    files = {path.name: path.read_bytes() for path in (CAPTURES / name).iterdir() if path.is_file()}
    runner.run("capture.folder", folder=Folder(files=files))
    assert runner.outcome.warnings == []
