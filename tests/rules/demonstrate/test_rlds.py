"""demonstrate.rlds: the files say of themselves what they hold; `test_readers.py` opens them with TensorFlow."""

from __future__ import annotations

import io
import json
import tempfile
from typing import Any

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.errors import RuleError
from dextera_build.formats import tfrecord
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.formats.test_tfrecord import records
from tests.rules.demonstrate.test_lerobot import filmed, of_lengths

LENGTHS = [4, 7, 3, 5]
PLACE = "lift_box/1.0.0/"


def written(made: Episodes, film: Film | None = None, profile: str = "cpu", **options: object) -> Folder:
    inputs: dict[str, Any] = {"episodes": made}
    if film is not None:
        inputs |= {"film": film, "view": episodes.view(film.width, film.height)}
    with tempfile.TemporaryDirectory() as scratch:
        folder: Folder = RuleRunner(scratch).run(
            "demonstrate.rlds", profile=profile, options=options, bundle=episodes.bundle(), **inputs
        )
    return folder


def examples(folder: Folder, split: str) -> list[dict[str, Any]]:
    """The features of each episode of a split, in the order of its files."""
    names = sorted(name for name in folder.files if f"-{split}.tfrecord-" in name)
    return [decoded(message) for name in names for message in records(folder.files[name])]


def decoded(message: bytes) -> dict[str, Any]:
    example = tfrecord._example().FromString(message)
    return {
        name: list(getattr(feature, feature.WhichOneof("kind")).value)
        for name, feature in example.features.feature.items()
    }


def document(folder: Folder, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(folder.files[PLACE + name])
    return found


def declared(node: dict[str, Any], path: str = "") -> dict[str, dict[str, Any]]:
    """Path of each feature of `features.json` -> its description."""
    inside = node.get("featuresDict", {}).get("features") or {}
    if "sequence" in node:
        return declared(node["sequence"]["feature"], path)
    if not inside:
        return {path.removeprefix("/"): node}
    return {name: each for key, part in inside.items() for name, each in declared(part, f"{path}/{key}").items()}


def test_every_feature_that_is_declared_is_written_with_its_size() -> None:
    made = of_lengths(LENGTHS)
    folder = written(made, filmed(made), valid_share=0.0)
    features = declared(document(folder, "features.json"))
    found = examples(folder, "train")
    assert len(found) == len(LENGTHS)
    for own, steps in zip(found, LENGTHS, strict=True):
        assert own.keys() == features.keys()
        for name, feature in features.items():
            width = int(
                np.prod([int(size) for size in feature.get("tensor", {}).get("shape", {}).get("dimensions", [])])
            )
            assert len(own[name]) == (steps * width if name.startswith("steps/") else 1), name
    assert json.loads(document(folder, "dataset_info.json")["description"])["cameras"]["workspace"]["width"] == 16
    image = features["steps/observation/image"]["image"]
    assert image == {"shape": {"dimensions": ["16", "16", "3"]}, "dtype": "uint8", "encodingFormat": "jpeg"}


def test_steps_are_those_that_were_recorded() -> None:
    made = of_lengths(LENGTHS)
    film = filmed(made)
    folder = written(made, film, valid_share=0.0, picture="png", instruction="Lift the box.")
    for own, (label, episode) in zip(examples(folder, "train"), made.in_order(), strict=True):
        steps = len(episode.joints)
        for name, values in (("observation/state", episode.joints), ("action", episode.action)):
            np.testing.assert_array_equal(np.float32(own[f"steps/{name}"]).reshape(steps, -1), values)
        assert own["steps/is_first"] == [1] + [0] * (steps - 1)
        assert own["steps/is_last"] == own["steps/is_terminal"] == own["steps/reward"] == [0] * (steps - 1) + [1]
        assert set(own["steps/language_instruction"]) == {b"Lift the box."}
        pictures = [np.asarray(Image.open(io.BytesIO(each))) for each in own["steps/observation/image"]]
        np.testing.assert_array_equal(pictures, film.pixels(label))
        assert own["episode_metadata/label"] == [label.encode()]
        assert own["episode_metadata/seed"] == [episode.start.seed]
        assert json.loads(own["episode_metadata/start"][0])["qpos"] == episode.start.qpos.tolist()


def test_splits_and_files_are_those_that_the_info_names() -> None:
    made = of_lengths([2] * 20)
    folder = written(made, valid_share=0.3, shard_mb=1e-3)
    info = document(folder, "dataset_info.json")
    assert (info["name"], info["version"], info["fileFormat"]) == ("lift_box", "1.0.0", "tfrecord")
    labels = []
    for split in info["splits"]:
        lengths = [int(length) for length in split["shardLengths"]]
        names = [f"{PLACE}lift_box-{split['name']}.tfrecord-{n:05d}-of-{len(lengths):05d}" for n in range(len(lengths))]
        assert [len(records(folder.files[name])) for name in names] == lengths
        assert sum(len(folder.files[name]) for name in names) == int(split["numBytes"])
        labels += [own["episode_metadata/label"][0].decode() for own in examples(folder, split["name"])]
    assert [split["name"] for split in info["splits"]] == ["train", "val"]
    assert len(info["splits"][0]["shardLengths"]) > 1
    assert sorted(labels) == sorted(made.items)
    assert len(folder.files) == sum(len(split["shardLengths"]) for split in info["splits"]) + 3


def test_the_same_episodes_give_the_same_bytes() -> None:
    made = of_lengths([4, 6])
    assert written(made, filmed(made)).files == written(made, filmed(made)).files


def test_what_cannot_be_written_is_refused() -> None:
    made = of_lengths([2, 3])
    with pytest.raises(RuleError, match="no episode counts"):
        written(made.model_copy(update={"items": {}}))
    with pytest.raises(ValueError, match="name"):
        written(made, name="Lift box")


def test_the_stub_states_the_same_features() -> None:
    made = of_lengths([2])
    assert document(written(made, profile="stub"), "features.json") == document(written(made), "features.json")
