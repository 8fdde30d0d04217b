"""Panoramas: files hold the picture, its place and what was seen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from tests.formats.test_views import pose, views

PIXELS = Image(pixels=np.random.default_rng(2).integers(0, 256, (4, 8, 3), dtype=np.uint8))
PLACE = Pose(parent="room", child="camera", matrix=pose(5))
SEEN = np.random.default_rng(3).integers(0, 2, (4, 8)).astype(bool)


@pytest.mark.parametrize("seen", [None, SEEN])
def test_a_panorama_comes_back(tmp_path: Path, seen: np.ndarray | None) -> None:
    written = Panorama(image=PIXELS, pose=PLACE, seen=seen).save(tmp_path / "room.json")
    assert all(path.is_file() for path in written)
    again = Panorama.load(tmp_path / "room.json")
    assert (again.image.pixels == PIXELS.pixels).all()
    assert again.pose.parent == "room"
    assert np.allclose(again.pose.matrix, PLACE.matrix)
    assert np.array_equal(again.seen, seen)


def test_another_kind_of_views_is_refused(tmp_path: Path) -> None:
    views().save(tmp_path / "three" / "transforms.json")
    with pytest.raises(ArtifactError, match="cannot be read as a panorama"):
        Panorama.load(tmp_path / "three" / "transforms.json")


def test_a_mask_of_another_size_is_refused() -> None:
    with pytest.raises(ArtifactError, match=r"Panorama\.seen is 4 x 8 px") as caught:
        Panorama(image=PIXELS, pose=PLACE, seen=SEEN.T.copy())
    assert caught.value.code == "DXB-A203"


@pytest.mark.parametrize("name", ["masks/absent.png", "../room.png", "room.json"])
def test_a_mask_that_is_none_is_told(tmp_path: Path, name: str) -> None:
    Panorama(image=PIXELS, pose=PLACE, seen=SEEN).save(tmp_path / "room.json")
    facts = json.loads((tmp_path / "room.json").read_text())
    facts["frames"][0]["mask_path"] = name
    (tmp_path / "room.json").write_text(json.dumps(facts))
    with pytest.raises(ArtifactError, match="cannot be read as a panorama") as caught:
        Panorama.load(tmp_path / "room.json")
    assert "its mask" in str(caught.value.facts["why"])


def test_it_is_shown() -> None:
    made = Panorama(image=PIXELS, pose=PLACE, seen=np.arange(32).reshape(4, 8) < 8)
    assert list(made.facts()) == ["8 x 4 px", "25% seen", "frame room"]
    assert made.picture().startswith(b"\x89PNG")
