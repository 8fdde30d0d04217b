"""benchmark.modalities: twin and photograph as colours, masks and depth, and how well they agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.objects.view import InstanceMap, Segmentation
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast
from dextera_build.geometry.plot import COLOURS
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.simulate.scene.scene import scene
from tests import factories

LENS, TABLE = factories.camera(), factories.support()
BOX = factories.pose(-0.15)
CAPTURE = factories.capture(LENS, TABLE)


@pytest.fixture
def twin(tmp_path: Path) -> Scene:
    """A box on the table."""
    assets = Collection[Asset](items={"Red Box": factories.box_asset(BOX)})
    return scene(Context(scratch=tmp_path), assets, factories.background(size=(240, 320)), TABLE, LENS)


def seen(*names: str) -> Segmentation:
    """Objects of which the first is where ray casting sees the box, and the others nowhere."""
    mesh = factories.box_asset(BOX).body.links["base"].mesh
    posed = raycast.posed(mesh.vertices, mesh.faces, BOX)
    cast = raycast.render([posed], LENS.matrix(), TABLE.camera_pose.matrix, LENS.height, LENS.width)
    labels = (cast.index >= 0).astype(np.int32)
    return Segmentation(items={}, names=names, map=InstanceMap(labels=labels, fixed=np.zeros(labels.shape, bool)))


@pytest.mark.medium
def test_masks_and_depths_of_both_are_compared_by_name(twin: Scene, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    given = {"photograph": CAPTURE.photograph, "scene": twin}
    made: Image = runner.run(
        "benchmark.modalities", backend="mujoco", objects=seen("Red Box"), measured=CAPTURE.measured, **given
    )
    metrics = runner.outcome.metrics
    assert metrics["mask_iou"][0] > 0.95
    assert metrics["depth_difference"][0] < 0.002
    painted = [(made.pixels[:, half] == COLOURS[0]).all(axis=2).sum() for half in (slice(0, 323), slice(326, None))]
    assert painted[0] > 1000
    assert painted[0] == pytest.approx(painted[1], rel=0.05), "an object has one colour on both sides"
    both: Image = runner.run("benchmark.modalities", backend="mujoco", objects=seen("Red Box", "cup"), **given)
    assert runner.outcome.metrics == {"mask_iou": (pytest.approx(metrics["mask_iou"][0] / 2), "")}
    assert both.pixels.shape[0] < made.pixels.shape[0] - 240, "no row of depths"


def test_a_photograph_of_another_camera_is_refused(twin: Scene, tmp_path: Path) -> None:
    small = Image(pixels=CAPTURE.photograph.rgb.pixels[::2, ::2])
    other = CAPTURE.photograph.model_copy(update={"rgb": small, "camera": LENS.scaled(0.5)})
    with pytest.raises(RuleError, match="camera is not the photograph's"):
        RuleRunner(tmp_path).run("benchmark.modalities", backend="stub", photograph=other, objects=seen(), scene=twin)
