"""SuperPoint with LightGlue: the real classes run with random weights, and what they say is read as they mean it."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.code.loader import Library
from dextera_build.testing import RuleRunner
from tests.installed import needs
from tests.rules.align import painted, tiny_lightglue

torch = pytest.importorskip("torch")
needs("transformers")

NAME = "superpoint_lightglue"


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_lightglue.lightglue(tmp_path_factory.mktemp("weights") / "lightglue_superpoint")


@pytest.fixture
def backend() -> ModuleType:
    return Library().find("align.matches").backends[NAME].module


def picture(height: int, width: int) -> Image:
    return Image(pixels=painted.paint(3)[:height, :width].copy())


@pytest.mark.medium
def test_it_runs_on_pictures_of_two_sizes(tmp_path: Path, weights: Path) -> None:
    runner = RuleRunner(tmp_path, weights={"lightglue_superpoint": weights})
    options = {"points": 60, NAME: {"least_confidence": 0.0}}
    found: Matches = runner.run(
        "align.matches", backend=NAME, options=options, first=picture(120, 160), second=picture(200, 220)
    )
    assert found.method == "SuperPoint + LightGlue"
    assert len(found.first) <= 60


@pytest.mark.medium
def test_points_are_pixels_of_each_picture(backend: ModuleType) -> None:
    """Trap 20: integer pixel centres survive the change of size, and points of the padding are dropped."""

    def model(pictures: Any) -> SimpleNamespace:
        assert pictures.shape == (1, 2, 3, 480, 640)
        assert 0.5 < float(pictures.max()) <= 1.0
        assert torch.equal(pictures[0, :, 0], pictures[0, :, 2])  # grey
        places = torch.tensor([[[1.5, 1.5], [319.5, 239.5], [0, 0]], [[319.5, 239.5], [1.5, 1.5], [3.5, 7.5]]])
        return SimpleNamespace(
            keypoints=(places / torch.tensor([640.0, 480.0]))[None],
            mask=torch.tensor([[[1, 1, 0], [1, 1, 1]]]),
            matches=torch.tensor([[[1, 0, 2], [1, 0, -1]]]),
            matching_scores=torch.tensor([[[0.9, 0.4, 0.8], [0.4, 0.9, 0.0]]]),
        )

    decoder = SimpleNamespace(max_keypoints=-1)
    made: Any = model
    made.device = "cpu"
    made.keypoint_detector = SimpleNamespace(keypoint_decoder=decoder)
    found = backend.matched(backend.Matcher(made), picture(240, 320), picture(120, 160), 77, 0.5)
    assert decoder.max_keypoints == 77
    assert np.allclose(found.first, [[0.5, 0.5]])
    assert np.allclose(found.second, [[0.0, 0.0]], atol=1e-6)
    assert np.allclose(found.confidence, [0.9])
