"""align.object without depth: the silhouette on the support finds place, turn and scale."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Placement
from dextera_build.errors import RuleError
from dextera_build.geometry import metrics, transforms
from dextera_build.testing import RuleRunner
from tests import factories, object_views

TRUTH = factories.pose(0.03, 0.02, 0.0, 0.7)
LARGER = 5.0


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def placed(runner, name: str, hidden: np.ndarray | None = None) -> tuple[Placement, float]:
    """Placement of a body that is five times too large, and Chamfer-L1 of the placed surface [m]."""
    true = object_views.mesh(getattr(object_views, name)())
    large = true.model_copy(update={"vertices": true.vertices * np.float32(LARGER)})
    instance = object_views.view(true, TRUTH, hidden=hidden)
    support = factories.support().model_copy(update={"camera_pose": instance.measured.camera_pose})
    body = object_views.body(large).model_copy(update={"pose": None})
    found = runner.run("align.object", body=body, view=instance.view, support=support)
    ours = transforms.apply(found.pose.matrix, found.scale * large.vertices.astype(np.float64))
    surfaces = [transforms.apply(TRUTH, true.vertices.astype(np.float64)), ours]
    points = [metrics.sample_surface(vertices, true.faces, 20000, 0) for vertices in surfaces]
    return found, metrics.chamfer_and_f(points[0], points[1], 0.005)[0]


@pytest.mark.medium
@pytest.mark.parametrize("name", ["bracket", "mug", "bowl", "cup"])
def test_place_turn_and_scale_follow_from_the_mask(runner, name):
    found, chamfer = placed(runner, name)
    assert found.scale * LARGER == pytest.approx(1.0, abs=0.01)
    assert chamfer < 0.003
    assert found.method == "silhouette on the support"
    assert (found.residual_m, found.overlap) == (None, None)
    assert "residual" not in runner.outcome.line
    assert found.ambiguous == (name in ("bowl", "cup"))


@pytest.mark.medium
def test_what_is_hidden_does_not_pull(runner):
    hidden = np.zeros((240, 320), bool)
    hidden[:, 175:] = True
    found, _ = placed(runner, "bracket", hidden)
    assert found.scale * LARGER == pytest.approx(1.0, abs=0.1)


@pytest.mark.medium
def test_the_same_input_gives_the_same_bytes(runner):
    assert runner.encode(placed(runner, "mug")[0]) == runner.encode(placed(runner, "mug")[0])


def test_without_depth_and_support_there_is_nothing_to_stand_on(runner):
    instance = object_views.view(object_views.mesh(object_views.bracket()), TRUTH)
    body = object_views.body(object_views.mesh(object_views.bracket()))
    with pytest.raises(RuleError, match="no measured depth, and no support is given") as caught:
        runner.run("align.object", body=body, view=instance.view)
    assert caught.value.hint == "give the input `support`, or add the depth to the capture"
