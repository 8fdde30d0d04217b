"""Feature maps: their file, where their cells are, and what is refused."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image as Pillow

from dextera_build.artifacts.feature_map import FeatureMap
from dextera_build.errors import ArtifactError
from tests.artifacts.generated import values
from tests.artifacts.test_base import Memory


def ramp(rows: int = 6, columns: int = 8, width: int = 112, height: int = 84) -> FeatureMap:
    """Features that are the place of their cell in the picture."""
    made = FeatureMap(
        features=np.zeros((rows, columns, 2), np.float32), width=width, height=height, network="ramp-1 layer 3"
    )
    return made.model_copy(update={"features": made.centres().astype(np.float32)})


@given(values(FeatureMap))
@settings(deadline=None, max_examples=30)
def test_a_file_gives_back_what_was_saved(tmp_path_factory, made):
    (path,) = made.save(tmp_path_factory.mktemp("npz") / "a.npz")
    again = FeatureMap.load(path)
    assert again.encode(Memory().put) == made.encode(Memory().put)


def test_equal_maps_are_equal_files(tmp_path):
    first, second = (ramp().save(tmp_path / name)[0].read_bytes() for name in ("a.npz", "b.npz"))
    assert first == second


def test_cells_cover_the_picture():
    centres = ramp().centres()
    assert centres[0, 0].tolist() == [6.5, 6.5]
    assert (centres[-1, -1] + 7).tolist() == [111.5, 83.5]


def test_between_the_middles_features_are_linear():
    random = np.random.default_rng(0)
    pixels = random.uniform([6.5, 6.5], [104.5, 76.5], (50, 2))
    assert np.abs(ramp().at(pixels) - pixels).max() < 1e-5
    beyond = ramp().at(np.array([[-0.5, -0.5], [111.5, 40.0]]))
    assert beyond[0].tolist() == [6.5, 6.5]
    assert beyond[1] == pytest.approx([104.5, 40.0])


def test_one_cell_has_one_feature():
    made = FeatureMap(features=np.full((1, 1, 3), 7, np.float32), width=4, height=4, network="n")
    assert made.at(np.array([[0.0, 3.0]])).tolist() == [[7, 7, 7]]


def pixels(made: FeatureMap) -> np.ndarray:
    shown = made.picture()
    assert shown is not None
    return np.asarray(Pillow.open(io.BytesIO(shown)))


def test_the_picture_tells_cells_apart():
    shown = pixels(ramp())
    assert shown.shape == (180, 240, 3)
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) == 48
    assert np.ptp(shown, axis=(0, 1)).tolist() == [255, 255, 0]
    even = ramp().model_copy(update={"features": np.ones((2, 2, 5), np.float32)})
    assert np.ptp(pixels(even)) == 0
    assert even.model_copy(update={"features": np.zeros((0, 2, 5), np.float32)}).picture() is None


def test_its_line():
    assert repr(ramp()) == "FeatureMap(8 x 6 cells, 2 features, 112 x 84 px, ramp-1 layer 3)"


def written(path: Any, **arrays: Any) -> None:
    good = {"features": np.zeros((1, 1, 1)), "size": np.array([4, 4]), "network": np.array("n")}
    np.savez(path, **{name: array for name, array in (good | arrays).items() if array is not None})


WRONG = "`features` are not floats, `size` is not two whole numbers, or `network` is no text"


@pytest.mark.parametrize(
    ("arrays", "why"),
    [
        ({"network": None}, "it has no array `network`"),
        ({"features": np.zeros((1, 1, 1), int)}, WRONG),
        ({"size": np.array([4.0, 4.0])}, WRONG),
        ({"network": np.array(3)}, WRONG),
        ({"features": np.array([[["a pickle"]]], object)}, "Object arrays cannot be loaded when allow_pickle=False"),
    ],
)
def test_another_archive_is_refused(tmp_path, arrays, why):
    written(tmp_path / "a.npz", **arrays)
    with pytest.raises(ArtifactError, match=r"`a\.npz` cannot be read as NPZ of a feature map") as caught:
        FeatureMap.load(tmp_path / "a.npz")
    assert why in caught.value.facts["why"]


def test_a_damaged_archive_is_refused(tmp_path):
    path = ramp().save(tmp_path / "a.npz")[0]
    whole = path.read_bytes()
    single = io.BytesIO()
    np.save(single, np.zeros(3))
    for data in (whole[:-30], whole[:200] + b"?" * 50 + whole[250:], b"", b"no archive", single.getvalue()):
        path.write_bytes(data)
        with pytest.raises(ArtifactError, match="cannot be read as NPZ"):
            FeatureMap.load(path)


def test_a_wrong_form_is_refused(tmp_path):
    written(tmp_path / "a.npz", features=np.zeros((2, 2)))
    with pytest.raises(ArtifactError, match=r"FeatureMap\.features: shape is \(2, 2\)"):
        FeatureMap.load(tmp_path / "a.npz")
    written(tmp_path / "a.npz", size=np.array([0, 4]))
    with pytest.raises(ArtifactError, match=r"FeatureMap\.width: Input should be greater than 0"):
        FeatureMap.load(tmp_path / "a.npz")
