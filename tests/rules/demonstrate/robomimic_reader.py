"""Opens a file with robomimic's own loader, in its environment: `robomimic_reader.py FILE OUT.npz`.

It imports torchvision, whose operators for pictures need another torch and are only declared here.
"""

from __future__ import annotations

import json
import sys

import h5py
import numpy as np
import torch

LIBRARY = torch.library.Library("torchvision", "DEF")
for operator in ("nms", "qnms"):
    LIBRARY.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

from robomimic.utils import env_utils, file_utils, obs_utils  # noqa: E402
from robomimic.utils.dataset import SequenceDataset  # noqa: E402

LOW = ["state", "object", "goal"]


def main(file: str, out: str) -> None:
    """Write what the loader gives: every step, windows of the demonstrations to validate on, shapes, environment."""
    with h5py.File(file) as opened:
        names = list(opened["data/demo_0/obs"])
    pictures, depth = ([name for name in names if name.endswith(end)] for end in ("_image", "_depth"))
    obs_utils.initialize_obs_utils_with_obs_specs([{"obs": {"low_dim": LOW, "rgb": pictures, "depth": depth}}])
    seen = (*LOW, *pictures, *depth)
    keys = {"obs_keys": seen, "dataset_keys": ("actions", "rewards", "dones")}
    whole = SequenceDataset(file, **keys, hdf5_cache_mode="low_dim")
    items = [whole[number] for number in range(len(whole))]
    found = {key: np.concatenate([item[key] for item in items]) for key in ("actions", "rewards", "dones")}
    found |= {f"obs/{key}": np.concatenate([item["obs"][key] for item in items]) for key in seen}
    found |= {f"next_obs/{key}": np.concatenate([item["next_obs"][key] for item in items]) for key in seen}
    for side in ("train", "valid"):
        part = SequenceDataset(file, **keys, filter_by_attribute=side, seq_length=3)
        found[f"{side}/demos"] = np.array(part.demos)
        found[f"{side}/window"] = part[0]["actions"]
    # The loader cannot normalise pictures.
    numbers = SequenceDataset(file, obs_keys=LOW, dataset_keys=("actions",), hdf5_normalize_obs=True)
    found["mean"] = numbers.get_obs_normalization_stats()["state"]["mean"]
    meta = file_utils.get_env_metadata_from_dataset(file)
    shapes = file_utils.get_shape_metadata_from_dataset(file, all_obs_keys=list(seen))
    # What a network gets: depth is clipped to 0..1 there.
    processed = obs_utils.process_obs_dict({name: items[0]["obs"][name] for name in (*pictures, *depth)})
    found |= {f"processed/{name}": np.asarray(value) for name, value in processed.items()}
    found["meta"] = np.array(json.dumps([meta, shapes], default=list))
    found["robosuite"] = np.array(env_utils.is_robosuite_env(env_meta=meta))
    np.savez(out, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
