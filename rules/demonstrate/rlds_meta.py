"""`features.json` and `dataset_info.json` of TensorFlow Datasets: with them its loader opens a folder without code."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle

from . import facts, rlds_names
from .lerobot_features import ACTION, Feature

if TYPE_CHECKING:
    from .cameras import Camera
    from .rlds import RldsOptions

FEATURES = "tensorflow_datasets.core.features"
FLAGS = ("is_first", "is_last", "is_terminal")
TEMPLATE = "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}"
TEXTS = ("label", "origin", "start", "segments")
"""Texts in the metadata of an episode; `start` and `segments` are JSON."""


@dataclass(frozen=True)
class Split:
    """The files of one split."""

    name: str
    """`train` or `val`."""
    lengths: tuple[int, ...]
    """Episodes per file."""
    size: int
    """Size of all files [bytes]."""


def features(observed: Mapping[str, Feature], width: int, seen: Sequence[Camera], options: RldsOptions) -> bytes:
    """`features.json`.

    Args:
        observed: Name -> vector that a policy may observe.
        width: Numbers of an action.
        seen: Its cameras.
        options: Encoding of the pictures.
    """
    found = {name: _tensor("float32", feature.width) for name, feature in observed.items()}
    picture, depth = (rlds_names.key(kind, len(seen) > 1) for kind in (rlds_names.PICTURE, rlds_names.DEPTH))
    for each in seen:
        if each.film is not None:
            found[picture.format(each.name)] = _image(each.film, 3, "uint8", options.picture)
        if each.film is not None and each.has_depth:
            found[depth.format(each.name)] = _image(each.film, 1, "uint16", "png")
    step = {
        "observation": _named(found),
        ACTION: _tensor("float32", width),
        "reward": _tensor("float32"),
        "discount": _tensor("float32"),
        **{flag: _tensor("bool") for flag in FLAGS},
        "language_instruction": _text(),
    }
    steps = {"feature": _named(step), "length": "-1"}
    metadata = {name: _text() for name in TEXTS} | {"success": _tensor("bool"), "seed": _tensor("int64")}
    whole = {
        "steps": {"pythonClassName": f"{FEATURES}.dataset_feature.Dataset", "sequence": steps},
        "episode_metadata": _named(metadata),
    }
    return facts.document(_named(whole))


def about(bundle: TaskBundle, episodes: Episodes, seen: Sequence[Camera]) -> dict[str, object]:
    """What other forms have in `meta/dextera.json` and `meta/cameras.json`."""
    found = facts.cameras(bundle, seen)
    return facts.about(bundle, episodes) | ({"cameras": found} if found else {})


def info(name: str, version: str, described: Mapping[str, object], splits: list[Split]) -> bytes:
    """`dataset_info.json`.

    Args:
        name: Name of the data set.
        version: Its version.
        described: The content of `about`, which becomes the description, as JSON.
        splits: Its splits.
    """
    written = [
        {
            "filepathTemplate": TEMPLATE,
            "name": split.name,
            "numBytes": str(split.size),
            "shardLengths": [str(length) for length in split.lengths],
        }
        for split in splits
    ]
    return facts.document(
        {
            "description": json.dumps(described, sort_keys=True),
            "fileFormat": "tfrecord",
            "name": name,
            "splits": written,
            "version": version,
        }
    )


def file(name: str, split: str, number: int, count: int) -> str:
    """Name of a file by `TEMPLATE`."""
    return f"{name}-{split}.tfrecord-{number:05d}-of-{count:05d}"


def _named(features: Mapping[str, object]) -> dict[str, object]:
    inside = {"features": dict(features)}
    return {"pythonClassName": f"{FEATURES}.features_dict.FeaturesDict", "featuresDict": inside}


def _image(film: Film, channels: int, dtype: str, encoding: str) -> dict[str, object]:
    size = [str(film.height), str(film.width), str(channels)]
    picture = {"shape": {"dimensions": size}, "dtype": dtype, "encodingFormat": encoding}
    return {"pythonClassName": f"{FEATURES}.image_feature.Image", "image": picture}


def _tensor(dtype: str, width: int | None = None) -> dict[str, object]:
    shape = {} if width is None else {"dimensions": [str(width)]}
    own = {"shape": shape, "dtype": dtype, "encoding": "none"}
    return {"pythonClassName": f"{FEATURES}.tensor_feature.Tensor", "tensor": own}


def _text() -> dict[str, object]:
    return {"pythonClassName": f"{FEATURES}.text_feature.Text", "text": {}}
