"""Runs policies of learn.act: action chunks of the network [rad]."""

from __future__ import annotations

import numpy as np
import torch

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible, weights
from dextera_build.learning.samples import pixels
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict

from . import network


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The network of a checkpoint, ready to run in a task bundle."""
    contract = checkpoint.contract
    made = network.of_contract(contract)
    weights.fill(made, weights.from_bytes(checkpoint.weights))
    made.eval()
    mean, scale = (np.array(part, np.float64) for part in (contract.action.mean, contract.action.scale))

    def targets(inputs: Fields, step: int) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            tensors = {name: torch.from_numpy(np.ascontiguousarray(field)) for name, field in inputs.items()}
            if "rgb" in tensors:
                tensors["rgb"] = pixels(tensors["rgb"])
            chunk: np.ndarray = made(tensors)[0].numpy()
        return chunk.astype(np.float64) * scale + mean

    return targets
