"""The data sets of a task of the paper open in the loaders that they are meant for, which find what was recorded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.api import Project, Result
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from tests import readers

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

REPO = Path(__file__).parents[3]
SMALL = {
    "sources.episodes": 3,
    "shards.episodes": 6,
    "shards.per_shard": 3,
    "view.width_px": 96,
    "view.height_px": 72,
    "robomimic.valid_share": 0.3,
    "rlds.valid_share": 0.3,
    "rlds.picture": "png",
    "rlds.shard_mb": 0.5,
}
WORDS = "lift mustard bottle"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


@pytest.fixture(scope="module")
def built() -> Result:
    """A small data set of a task in every form, in the store of this checkout."""
    result = Project.find(REPO).build("task/kl/lift_mustard_bottle", "forms", settings=SMALL)
    assert result.ok, result.errors
    return result


@pytest.fixture(scope="module")
def made(built: Result) -> Episodes:
    found = built.artifact("episodes")
    assert isinstance(found, Episodes)
    assert len(found.items) == SMALL["shards.episodes"]
    return found


@pytest.fixture(scope="module")
def pixels(built: Result, made: Episodes) -> np.ndarray:
    """All pictures (T, H, W, 3) uint8, episode by episode."""
    film = built.artifact("pictures")
    assert isinstance(film, Film)
    return np.concatenate([film.pixels(label) for label, _ in made.in_order()])


def written(built: Result, node: str, out: Path) -> Path:
    folder = built.artifact(node)
    assert isinstance(folder, Folder)
    folder.export(out, node)
    return out


def joined(made: Episodes, name: str) -> np.ndarray:
    """A field of all episodes, one after another."""
    return np.concatenate([getattr(episode, name) for _, episode in made.in_order()])


def tracked(episode: Episode) -> np.ndarray:
    """Poses of the objects and positions of their joints (T, N)."""
    return np.concatenate([episode.objects.reshape(len(episode.joints), -1), episode.displacement], axis=1)


def check_lerobot(found: dict[str, np.ndarray], made: Episodes, pixels: np.ndarray) -> None:
    np.testing.assert_array_equal(found["observation.state"], joined(made, "joints"))
    np.testing.assert_array_equal(found["action"], joined(made, "action"))
    objects = np.concatenate([tracked(episode) for _, episode in made.in_order()])
    np.testing.assert_array_equal(found["observation.environment_state"], objects)
    assert set(found["task"]) == {WORDS}
    assert found["pixels"].shape == (len(pixels), 3, *pixels.shape[1:3])
    assert readers.psnr(found["pixels"], pixels) > 28
    assert np.abs(found["pixels"][0, :, 0, 0] - pixels[0, 0, 0] / 255.0).max() < 0.1
    actions = joined(made, "action").astype(np.float64)
    np.testing.assert_allclose(found["mean"], actions.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(found["std"], actions.std(axis=0), atol=1e-6)
    np.testing.assert_array_equal(found["min"], actions.min(axis=0))
    np.testing.assert_array_equal(found["max"], actions.max(axis=0))


def test_lerobot_for_version_3_reads_it(built: Result, made: Episodes, pixels: np.ndarray, tmp_path: Path) -> None:
    data = written(built, "lerobot", tmp_path / "set")
    found = readers.read("lerobot-0.4", "lerobot_reader.py", data, tmp_path / "found.npz")
    check_lerobot(found, made, pixels)
    for name, part in QUANTILES.items():
        np.testing.assert_allclose(found[name], np.quantile(joined(made, "action"), part, axis=0), atol=1e-5)


def test_lerobot_for_version_2_reads_it(built: Result, made: Episodes, pixels: np.ndarray, tmp_path: Path) -> None:
    data = written(built, "lerobot_v21", tmp_path / "set")
    found = readers.read("lerobot-0.3", "lerobot_reader.py", data, tmp_path / "found.npz")
    check_lerobot(found, made, pixels)
    parts = json.loads((data / "meta" / "modality.json").read_text())
    widths = {kind: sum(part["end"] - part["start"] for part in parts[kind].values()) for kind in ("action", "state")}
    seen = ("observation.state", "observation.environment_state", "observation.goal")
    sizes = {name: int(np.prod(found[name].shape[1:])) for name in ("action", *seen)}
    assert widths == {"action": sizes["action"], "state": sum(sizes[name] for name in seen)}


def test_robomimic_reads_it(built: Result, made: Episodes, pixels: np.ndarray, tmp_path: Path) -> None:
    file = written(built, "robomimic", tmp_path / "set") / "demo.hdf5"
    found = readers.read("robomimic", "robomimic_reader.py", file, tmp_path / "found.npz")
    np.testing.assert_array_equal(found["obs/state"], joined(made, "joints"))
    np.testing.assert_array_equal(found["obs/object"], np.concatenate([tracked(each) for _, each in made.in_order()]))
    np.testing.assert_array_equal(found["obs/workspace_image"], pixels)
    after = [np.append(np.arange(1, count), count - 1) for count in (len(each.joints) for _, each in made.in_order())]
    firsts = np.cumsum([0, *(len(rows) for rows in after)])
    rows = np.concatenate([first + rows for first, rows in zip(firsts, after, strict=False)])
    np.testing.assert_array_equal(found["next_obs/workspace_image"], pixels[rows])
    np.testing.assert_array_equal(found["next_obs/state"], joined(made, "joints")[rows])
    meta, shapes = json.loads(str(found["meta"]))
    assert meta["env_name"].startswith("dxb/LiftMustardBottle-")
    assert not found["robosuite"]
    assert shapes["ac_dim"] == joined(made, "action").shape[1]
    assert shapes["all_shapes"]["workspace_image"] == [3, *pixels.shape[1:3]]
    assert {*found["train/demos"], *found["valid/demos"]} == {f"demo_{number}" for number in range(len(made.items))}
    np.testing.assert_allclose(found["mean"][0], joined(made, "joints").mean(axis=0), atol=1e-4)
    # It raises if an action is outside -1..1.
    said = readers.run("robomimic", "-m", "robomimic.scripts.get_dataset_info", "--dataset", file)
    assert f"total transitions: {len(pixels)}" in said


def test_tensorflow_datasets_reads_it(built: Result, made: Episodes, pixels: np.ndarray, tmp_path: Path) -> None:
    data = written(built, "rlds", tmp_path / "set")
    found = readers.read("rlds", "rlds_reader.py", data, tmp_path / "found.npz")
    labels = {side: [label.decode() for label in found[f"{side}/metadata/label"]] for side in ("train", "val")}
    assert sorted(labels["train"] + labels["val"]) == sorted(made.items)
    assert all(labels.values())
    assert len(list(data.glob("*/*/*-train.tfrecord-*"))) > 1
    first = dict(
        zip(made.items, np.cumsum([0, *(len(episode.joints) for _, episode in made.in_order())]), strict=False)
    )
    for side, own in labels.items():
        episodes = [made.items[label] for label in own]
        for key, wanted in (
            ("observation/state", [episode.joints for episode in episodes]),
            ("observation/environment_state", [tracked(episode) for episode in episodes]),
            ("action", [episode.action for episode in episodes]),
        ):
            np.testing.assert_array_equal(found[f"{side}/{key}"], np.concatenate(wanted))
        shown = [pixels[first[label] :][: len(made.items[label].joints)] for label in own]
        np.testing.assert_array_equal(found[f"{side}/observation/image"], np.concatenate(shown))
        assert set(found[f"{side}/language_instruction"]) == {WORDS.encode()}
        ends = np.cumsum([len(episode.joints) for episode in episodes]) - 1
        for key in ("is_last", "is_terminal", "reward"):
            np.testing.assert_array_equal(np.flatnonzero(found[f"{side}/{key}"]), ends)
        assert found[f"{side}/metadata/seed"].tolist() == [episode.start.seed for episode in episodes]
    one = made.items[labels["train"][0]]
    np.testing.assert_array_equal(found["undecoded/action"], one.action)
    np.testing.assert_array_equal(found["undecoded/picture"], pixels[first[labels["train"][0]]])
    assert found["undecoded/seed"].tolist() == [one.start.seed] * len(one.joints)
