"""A pair's data set with the pictures and the depth of two cameras opens in the loaders that it is meant for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.api import Project, Result
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from tests import readers
from tests.rules.demonstrate.test_mcap import read

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

REPO = Path(__file__).parents[3]
SMALL = {
    "pair/sources.episodes": 3,
    "pair/shards.episodes": 2,
    "pair/shards.per_shard": 2,
    "data/pictures/rlds.picture": "png",
    "data/pictures/rlds.valid_share": 0.0,
}
CAMERAS = ("front", "side")
SIZE = (224, 224)
FILMS = {"front": "data/front_film", "side": "data/side_film"}


@pytest.fixture(scope="module")
def built() -> Result:
    """Two episodes of a pair in every form, in the store of this checkout."""
    result = Project.find(REPO).build("dataset/kl/lift_mustard_bottle", "pictures", settings=SMALL)
    assert result.ok, result.errors
    return result


@pytest.fixture(scope="module")
def labels(built: Result) -> list[str]:
    episodes = built.artifact("pair/episodes")
    assert isinstance(episodes, Episodes)
    return [label for label, _ in episodes.in_order()]


@pytest.fixture(scope="module")
def seen(built: Result, labels: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Camera -> its pictures (T, H, W, 3) uint8 and its depth (T, H, W) uint16 [mm], episode by episode."""
    found = {}
    for name, node in FILMS.items():
        film = built.artifact(node)
        assert isinstance(film, Film)
        assert (film.height, film.width) == SIZE
        found[name] = tuple(np.concatenate([of(label) for label in labels]) for of in (film.pixels, film.counts))
    return found  # type: ignore[return-value]


def written(built: Result, form: str, out: Path) -> Path:
    folder = built.artifact(f"data/pictures/{form}")
    assert isinstance(folder, Folder)
    folder.export(out, form)
    return out


def test_both_cameras_see_the_robot_act_from_different_sides(seen: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    for pixels, counts in seen.values():
        assert pixels.std() > 10
        # The robot moves: every fiftieth pixel at least is at another distance in the middle than at first.
        assert np.mean(np.abs(counts[len(counts) // 4].astype(int) - counts[0]) > 20) > 0.02
        assert np.mean(counts > 0) > 0.5
        assert 200 < np.median(counts[counts > 0]) < 3000
    apart = np.abs(seen["front"][1].astype(int) - seen["side"][1])
    assert np.mean(apart > 20) > 0.3


@pytest.mark.parametrize(("environment", "form"), [("lerobot-0.4", "lerobot"), ("lerobot-0.3", "lerobot_v21")])
def test_lerobot_reads_both_cameras_and_their_depth(
    environment: str,
    form: str,
    built: Result,
    seen: dict[str, tuple[np.ndarray, np.ndarray]],
    tmp_path: Path,
) -> None:
    data = written(built, form, tmp_path / "set")
    found = readers.read(environment, "lerobot_reader.py", data, tmp_path / "found.npz")
    for name, (pixels, counts) in seen.items():
        assert readers.psnr(found[f"seen/observation.images.{name}"], pixels) > 28
        # Whole millimetres, one channel, as they are.
        np.testing.assert_array_equal(found[f"seen/observation.images.{name}_depth"][:, 0], counts)


def test_robomimic_reads_both_cameras_and_their_depth(
    built: Result, seen: dict[str, tuple[np.ndarray, np.ndarray]], tmp_path: Path
) -> None:
    file = written(built, "robomimic", tmp_path / "set") / "demo.hdf5"
    found = readers.read("robomimic", "robomimic_reader.py", file, tmp_path / "found.npz")
    for name, (pixels, counts) in seen.items():
        np.testing.assert_array_equal(found[f"obs/{name}_image"], pixels)
        expected = np.where(counts <= 3000, counts, 0)
        np.testing.assert_allclose(found[f"obs/{name}_depth"][..., 0] * 3000, expected, atol=1e-3)
        # A network gets the same, channels first.
        np.testing.assert_allclose(found[f"processed/{name}_depth"][0, 0] * 3000, expected[0], atol=1e-3)


def test_tensorflow_datasets_reads_both_cameras_and_their_depth(
    built: Result, seen: dict[str, tuple[np.ndarray, np.ndarray]], tmp_path: Path
) -> None:
    data = written(built, "rlds", tmp_path / "set")
    found = readers.read("rlds", "rlds_reader.py", data, tmp_path / "found.npz")
    for name, (pixels, counts) in seen.items():
        np.testing.assert_array_equal(found[f"train/observation/{name}_image"], pixels)
        np.testing.assert_array_equal(found[f"train/observation/{name}_depth"][..., 0], counts)


def test_a_reader_of_ros_messages_reads_both_cameras_and_their_depth(
    built: Result, labels: list[str], seen: dict[str, tuple[np.ndarray, np.ndarray]], tmp_path: Path
) -> None:
    data = written(built, "mcap", tmp_path / "set")
    topics = [read(file.read_bytes()) for file in sorted(data.glob("episode-*.mcap"))]
    assert len(topics) == len(labels)
    for name, (_, counts) in seen.items():
        shown = [message for each in topics for _, message in each[f"/{name}/aligned_depth_to_color/image_raw"]]
        assert {(message.encoding, message.height, message.width) for message in shown} == {("16UC1", *SIZE)}
        found = [np.frombuffer(bytes(message.data), "<u2").reshape(SIZE) for message in shown]
        np.testing.assert_array_equal(found, counts)
