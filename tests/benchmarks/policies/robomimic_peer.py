"""robomimic's BC-RNN-GMM in robomimic's environment: `python robomimic_peer.py SETTING.json`.

It trains on a file of `demonstrate.robomimic` and writes one line of JSON about that. Afterwards it answers each line
of observations by feature, `{"observation.state": [...], ...}`, with an action in the units of the task, and an empty
line, the start of an episode, with null.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch.utils.data import DataLoader

# Operators of torchvision for pictures, which need another torch, are only declared; no policy on states calls them.
LIBRARY = torch.library.Library("torchvision", "DEF")
for operator in ("nms", "qnms"):
    LIBRARY.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

import robomimic  # noqa: E402
from robomimic.algo import RolloutPolicy, algo_factory  # noqa: E402
from robomimic.config import config_factory  # noqa: E402
from robomimic.utils import file_utils, obs_utils, train_utils  # noqa: E402

FEATURES = {"state": "observation.state", "object": "observation.environment_state", "goal": "observation.goal"}
"""Observations of the file -> features of dxb."""


def configured(given: dict[str, Any], keys: list[str]) -> Any:
    """The settings of robomimic of BC-RNN-GMM for states, with the sizes that the comparison asks for."""
    config = config_factory("bc")
    with config.values_unlocked():
        config.train.data, config.train.seq_length = given["file"], given["horizon"]
        config.train.batch_size, config.train.seed = given["batch"], given["seed"]
        config.train.hdf5_cache_mode = "all"
        config.observation.modalities.obs.low_dim = keys
        algo = config.algo
        algo.actor_layer_dims = ()
        algo.gmm.enabled, algo.gmm.num_modes = True, given["modes"]
        algo.rnn.enabled, algo.rnn.horizon = True, given["horizon"]
        algo.rnn.hidden_dim, algo.rnn.num_layers = given["hidden"], given["layers"]
        algo.optim_params.policy.learning_rate.initial = given["rate"]
    config.lock()
    return config


def trained(given: dict[str, Any], keys: list[str]) -> tuple[RolloutPolicy, dict[str, Any]]:
    """The policy, and facts of its training."""
    config = configured(given, keys)
    obs_utils.initialize_obs_utils_with_config(config)
    shapes = file_utils.get_shape_metadata_from_dataset(given["file"], all_obs_keys=keys)
    torch.manual_seed(given["seed"])
    np.random.seed(given["seed"])
    model = algo_factory("bc", config, shapes["all_shapes"], shapes["ac_dim"], torch.device("cpu"))
    data, _ = train_utils.load_data_for_training(config, obs_keys=shapes["all_obs_keys"])
    loader = DataLoader(data, batch_size=given["batch"], shuffle=True, drop_last=True)
    before = time.process_time()
    told = train_utils.run_epoch(model, loader, 1, num_steps=given["steps"])
    facts = {
        "seconds": time.process_time() - before,
        "numbers": sum(each.numel() for each in model.nets.parameters()),
        "loss": told["Loss"],
        "version": robomimic.__version__,
    }
    return RolloutPolicy(model), facts


def main(setting: Path) -> None:
    """Train, then answer until the input ends."""
    # robomimic prints to standard output.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    torch.set_num_threads(1)
    given = json.loads(setting.read_text())
    with h5py.File(given["file"]) as file:
        keys = [key for key in FEATURES if key in file["data/demo_0/obs"]]
        lower, upper = (np.array(file["data"].attrs[f"action_{side}"]) for side in ("lower", "upper"))
    policy, facts = trained(given, keys)
    answers.write(json.dumps(facts) + "\n")
    for line in sys.stdin:
        if not line.strip():
            policy.start_episode()
            answers.write("null\n")
            continue
        seen = json.loads(line)
        scaled = policy({key: np.array(seen[FEATURES[key]], np.float32) for key in keys})
        answers.write(json.dumps((lower + (scaled + 1) / 2 * (upper - lower)).tolist()) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
