"""Runs policies of learn.diffusion: the executed steps of a denoised window of actions [rad]."""

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
    present, every, seed = made.history - 1, int(contract.settings["every"]), int(contract.settings["seed"])

    def targets(inputs: Fields, step: int) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            tensors = {name: torch.from_numpy(np.ascontiguousarray(field)) for name, field in inputs.items()}
            if "rgb" in tensors:
                tensors["rgb"] = pixels(tensors["rgb"])
            # A trial repeats bit for bit, with other noise at each of its steps.
            random = torch.Generator().manual_seed(seed * 1_000_003 + step)
            window: np.ndarray = made.sample(tensors, torch.randn(1, *made.shape, generator=random))[0].numpy()
        return window[present : present + every].astype(np.float64) * scale + mean

    return targets
