"""factorize.mesh on photographs of a RealSense, with the sizes that are known of what they show."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Shape
from dextera_build.testing import RuleRunner
from tests import factories, object_views

CAPTURES = Path(__file__).parents[5] / "shared" / "captures"


def shape_in(name: str, folder: Path) -> Shape:
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"no capture `{name}`")
    told = json.loads((CAPTURES / name / "capture.json").read_text())
    counts = np.asarray(Pillow.open(CAPTURES / name / "depth.png")).astype(np.float32)
    capture = factories.rgbd(
        np.array(Pillow.open(CAPTURES / name / "rgb.png").convert("RGB")),
        counts * np.float32(told["depth_scale_m"]),
        Camera(**{key: told[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}),
    )
    runner = RuleRunner(folder)
    support = runner.run("align.support", **factories.shot(capture))
    elements = runner.run("factorize.parse", **factories.shot(capture), support=support)
    views = runner.run("factorize.segment", **factories.shot(capture), support=support, elements=elements).items
    largest = max(views.values(), key=lambda found: int(found.view.mask.sum()))
    shape: Shape = runner.run("factorize.mesh", **object_views.sights(largest))
    assert shape.mesh.is_closed
    assert len(shape.mesh.faces) < 7000
    return shape


@pytest.mark.slow
def test_a_sugar_box(tmp_path):
    shape = shape_in("table_sugar", tmp_path)
    assert np.sort(shape.mesh.extent) == pytest.approx([0.038, 0.089, 0.175], abs=0.005)


@pytest.mark.slow
def test_a_mustard_bottle(tmp_path):
    shape = shape_in("table_mustard", tmp_path)
    assert shape.hypothesis == "oval"
    assert shape.mesh.extent[2] == pytest.approx(0.190, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table_blue_mug", "table_white_bowl"])
def test_vessels_are_hollow(tmp_path, name):
    shape = shape_in(name, tmp_path)
    assert shape.hollow
    assert shape.walls
    assert shape.residual_m < 0.002
