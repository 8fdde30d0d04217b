"""Data sets with two cameras and depth: every form holds what each camera saw; films that do not fit are refused."""

from __future__ import annotations

import io
import json
import tempfile
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import View
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.rules.demonstrate.test_lerobot import of_lengths
from tests.rules.demonstrate.test_mcap import read
from tests.rules.demonstrate.test_rlds import PLACE, declared, document, examples

SIZE = (12, 16)
LENGTHS = [3, 5]
FARTHEST_MM = 4000


def filmed(made: Episodes, seed: int, depth: bool = True) -> Film:
    """Random colours, and random distances of which some are 0 and some beyond 3 m."""
    rng = np.random.default_rng(seed)
    frames, counts = {}, {}
    for label, episode in made.items.items():
        frames[label] = Film.packed(rng.integers(0, 256, (len(episode.joints), *SIZE, 3), np.uint8))
        distances = rng.integers(0, FARTHEST_MM, (len(episode.joints), *SIZE)).astype(np.uint16)
        counts[label] = Film.packed(np.where(distances < 300, np.uint16(0), distances))
    height, width = SIZE
    more: dict[str, Any] = {"depth": counts, "camera": episodes.view(width, height).camera} if depth else {}
    return Film(frames=frames, width=width, height=height, **more)


@pytest.fixture(scope="module")
def made() -> Episodes:
    return of_lengths(LENGTHS)


@pytest.fixture(scope="module")
def films(made: Episodes) -> dict[str, Film]:
    return {"front": filmed(made, 0), "side": filmed(made, 1)}


def written(form: str, made: Episodes, films: dict[str, Film], **options: object) -> Folder:
    height, width = SIZE
    views = {name: episodes.view(width, height) for name in films}
    with tempfile.TemporaryDirectory() as scratch:
        folder: Folder = RuleRunner(scratch).run(
            f"demonstrate.{form}",
            options=options,
            bundle=episodes.bundle(),
            episodes=made,
            films=Collection[Film](items=films),
            views=Collection[View](items=views),
        )
    return folder


def depth(made: Episodes, film: Film) -> np.ndarray:
    """Distances (T, H, W) [mm] of all steps."""
    return np.concatenate([film.counts(label) for label, _ in made.in_order()])


def decoded(rows: list[dict[str, bytes]]) -> np.ndarray:
    return np.array([np.array(Image.open(io.BytesIO(row["bytes"]))) for row in rows])


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_lerobot_has_a_video_and_lossless_depth_of_each_camera(
    made: Episodes, films: dict[str, Film], version: str
) -> None:
    folder = written("lerobot", made, films, version=version)
    info = json.loads(folder.files["meta/info.json"])
    tables = [
        pq.read_table(io.BytesIO(folder.files[name])) for name in sorted(folder.files) if name.startswith("data/")
    ]
    stats = json.loads(folder.files["meta/stats.json"])
    for name, film in films.items():
        assert sum(f"observation.images.{name}/" in file for file in folder.files if file.endswith(".mp4")) > 0
        assert info["features"][f"observation.images.{name}"]["shape"] == [*SIZE, 3]
        key = f"observation.images.{name}_depth"
        assert info["features"][key] == {
            "dtype": "image",
            "shape": [*SIZE, 1],
            "names": ["height", "width", "channels"],
            "info": {"is_depth_map": True, "depth_unit": "mm"},
        }
        expected = depth(made, film)
        found = np.concatenate([decoded(table[key].to_pylist()) for table in tables])
        np.testing.assert_array_equal(found, expected)
        for table in tables:
            known = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
            assert known[key] == {"_type": "Image"}
        if version == "v3.0":
            assert np.shape(stats[key]["mean"]) == (1, 1, 1)
            assert stats[key]["mean"][0][0][0] == pytest.approx(expected.mean())
            assert stats[key]["std"][0][0][0] == pytest.approx(expected.std())
            assert stats[key]["q99"][0][0][0] == pytest.approx(np.quantile(expected, 0.99))
            assert stats[key]["count"] == [sum(LENGTHS)]
    places = json.loads(folder.files["meta/cameras.json"])
    assert set(places) == set(films)
    if version == "v2.1":
        video = json.loads(folder.files["meta/modality.json"])["video"]
        assert video == {name: {"original_key": f"observation.images.{name}"} for name in films}
        assert info["total_videos"] == 2 * len(LENGTHS)
        (own, *_) = (json.loads(line)["stats"] for line in folder.files["meta/episodes_stats.jsonl"].splitlines())
        # LeRobot up to 0.3 refuses statistics of pictures that have not three channels.
        assert {np.shape(each["mean"]) for name, each in own.items() if "image" in name} == {(3, 1, 1)}


def test_depth_counts_for_the_size_of_a_data_file(made: Episodes, films: dict[str, Film]) -> None:
    folder = written("lerobot", made, films, data_file_mb=0.005)
    assert sum(name.startswith("data/") for name in folder.files) == len(LENGTHS)


def test_robomimic_has_pictures_and_scaled_depth_of_each_camera(made: Episodes, films: dict[str, Film]) -> None:
    folder = written("robomimic", made, films, reach_m=3.0)
    with h5py.File(io.BytesIO(folder.files["demo.hdf5"])) as file:
        assert file["data"].attrs["depth_reach_m"] == 3.0
        assert set(json.loads(file["data"].attrs["cameras"])) == set(films)
        for number, (label, _) in enumerate(made.in_order()):
            demo = file[f"data/demo_{number}"]
            for name, film in films.items():
                np.testing.assert_array_equal(demo[f"obs/{name}_image"], film.pixels(label))
                counts = film.counts(label)[..., None]
                found = np.array(demo[f"obs/{name}_depth"])
                assert (found.dtype, found.min(), found.max() <= 1.0) == (np.float32, 0.0, True)
                np.testing.assert_allclose(found * 3000, np.where(counts <= 3000, counts, 0), atol=1e-3)
                np.testing.assert_array_equal(demo[f"next_obs/{name}_depth"][:-1], found[1:])
                np.testing.assert_array_equal(demo[f"next_obs/{name}_depth"][-1], found[-1])


def test_rlds_has_pictures_and_depth_by_the_names_of_the_cameras(made: Episodes, films: dict[str, Film]) -> None:
    folder = written("rlds", made, films, picture="png", valid_share=0.0)
    features = declared(document(folder, "features.json"))
    found = examples(folder, "train")
    for name, film in films.items():
        image = features[f"steps/observation/{name}_depth"]["image"]
        assert image == {
            "shape": {"dimensions": [*(str(size) for size in SIZE), "1"]},
            "dtype": "uint16",
            "encodingFormat": "png",
        }
        for own, (label, _) in zip(found, made.in_order(), strict=True):
            shown = [np.array(Image.open(io.BytesIO(each))) for each in own[f"steps/observation/{name}_image"]]
            np.testing.assert_array_equal(shown, film.pixels(label))
            counts = [np.array(Image.open(io.BytesIO(each))) for each in own[f"steps/observation/{name}_depth"]]
            np.testing.assert_array_equal(counts, film.counts(label))
    description = json.loads(json.loads(folder.files[f"{PLACE}dataset_info.json"])["description"])
    assert set(description["cameras"]) == set(films)


def test_rlds_calls_the_only_camera_image_and_depth(made: Episodes, films: dict[str, Film]) -> None:
    folder = written("rlds", made, {"front": films["front"]})
    names = {name.rpartition("/")[2] for name in declared(document(folder, "features.json"))}
    assert {"image", "depth"} <= names


def test_a_recording_has_pictures_and_depth_of_each_camera(made: Episodes, films: dict[str, Film]) -> None:
    topics = read(written("mcap", made, films).files["episode-000001.mcap"])
    for name, film in films.items():
        shown = topics[f"/{name}/aligned_depth_to_color/image_raw"]
        assert [message.encoding for _, message in shown] == ["16UC1"] * LENGTHS[1]
        assert {message.header.frame_id for _, message in shown} == {f"{name}_color_optical_frame"}
        counts = [np.frombuffer(bytes(message.data), "<u2").reshape(SIZE) for _, message in shown]
        np.testing.assert_array_equal(counts, film.counts("1"))
        colours = topics[f"/{name}/color/image_raw/compressed"]
        pixels = [np.array(Image.open(io.BytesIO(bytes(message.data)))) for _, message in colours]
        np.testing.assert_array_equal(pixels, film.pixels("1"))
        assert len(topics[f"/{name}/color/camera_info"]) == LENGTHS[1]
    (_, fixed) = topics["/tf_static"][0]
    frames = {edge.child_frame_id for edge in fixed.transforms}
    assert {f"{name}_color_optical_frame" for name in films} <= frames


@pytest.mark.parametrize("form", ["lerobot", "robomimic", "rlds", "mcap"])
def test_the_card_describes_each_camera(form: str, made: Episodes, films: dict[str, Film]) -> None:
    text = written(form, made, films).files["README.md"].decode()
    assert "## Cameras" in text
    for name in films:
        assert f"picture of camera `{name}`" in text
        assert f"distance along the axis of camera `{name}`" in text
        assert f"`{name}`, 16 x 12 px, OpenCV axes" in text


def test_films_without_depth_have_none_in_the_files(made: Episodes) -> None:
    plain = {name: filmed(made, seed, depth=False) for seed, name in enumerate(("front", "side"))}
    info = json.loads(written("lerobot", made, plain).files["meta/info.json"])
    assert not [name for name in info["features"] if name.endswith("_depth")]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"film", "films"}, "`film` and `view` are for one camera, `films` and `views` for several"),
        ({"views"}, "there is no film of camera `front`"),
    ],
)
def test_films_of_one_and_of_several_cameras_do_not_go_together(
    made: Episodes, films: dict[str, Film], given: set[str], message: str, tmp_path: Any
) -> None:
    everything: dict[str, Any] = {
        "film": films["front"],
        "films": Collection[Film](items=films),
        "views": Collection[View](items={"front": episodes.view()}),
    }
    with pytest.raises(RuleError, match=message):
        RuleRunner(tmp_path).run(
            "demonstrate.lerobot",
            bundle=episodes.bundle(),
            episodes=made,
            **{name: everything[name] for name in given},
        )


def test_a_camera_needs_a_name_that_ros_and_the_hub_take(made: Episodes, films: dict[str, Film]) -> None:
    with pytest.raises(RuleError, match="`Front camera` cannot name a camera"):
        written("mcap", made, {"Front camera": films["front"]})
