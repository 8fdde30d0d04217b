"""Opens a data set with TensorFlow Datasets, in its environment: `rlds_reader.py FOLDER OUT.npz`.

`FOLDER/<name>/<version>` is opened by its path, and by its name as OpenVLA does, which leaves the steps undecoded.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf
import tensorflow_datasets as tfds


def main(folder: str, out: str) -> None:
    """Write every step of every split, and what OpenVLA's way of reading gives."""
    (version,) = Path(folder).glob("*/*")
    builder = tfds.builder_from_directory(str(version))
    found: dict[str, np.ndarray] = {}
    for split in builder.info.splits:
        read = tfds.ReadConfig(interleave_cycle_length=1)
        episodes = list(builder.as_dataset(split=split, shuffle_files=False, read_config=read))
        metadata = [{key: each.numpy() for key, each in episode["episode_metadata"].items()} for episode in episodes]
        found |= {f"{split}/metadata/{key}": np.array([own[key] for own in metadata]) for key in metadata[0]}
        found[f"{split}/lengths"] = np.array([len(episode["steps"]) for episode in episodes])
        steps = [step for episode in episodes for step in tfds.as_numpy(episode["steps"])]
        found |= {f"{split}/{key}": _stacked([step[key] for step in steps]) for key in steps[0] if key != "observation"}
        seen = [step["observation"] for step in steps]
        found |= {f"{split}/observation/{key}": np.stack([each[key] for each in seen]) for key in seen[0]}
    found |= _undecoded(tfds.builder(version.parent.name, data_dir=folder))
    np.savez(out, **found)


def _undecoded(builder: Any) -> dict[str, np.ndarray]:
    """The first episode with undecoded steps, its metadata repeated for every step."""
    data = builder.as_dataset(split="train", decoders={"steps": tfds.decode.SkipDecoding()}, shuffle_files=False)
    episode = next(iter(data))
    steps = episode["steps"]
    length = tf.shape(steps["action"])[0]
    repeated = {key: tf.repeat(value, length) for key, value in episode["episode_metadata"].items()}
    name = min(key for key in steps["observation"] if key.endswith("image"))
    picture = tf.io.decode_image(steps["observation"][name][0], expand_animations=False)
    found = {"action": steps["action"], "picture": picture, "words": steps["language_instruction"]}
    return {f"undecoded/{key}": _stacked(list(value.numpy())) for key, value in (found | repeated).items()}


def _stacked(values: list[Any]) -> np.ndarray:
    """One array; texts become bytes of one length."""
    return np.array(values, "S") if isinstance(values[0], bytes) else np.stack(values)


if __name__ == "__main__":
    main(*sys.argv[1:])
