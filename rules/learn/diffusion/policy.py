"""Runs policies of learn.diffusion: the executed steps of a denoised window of actions [rad]."""

from __future__ import annotations

import numpy as np
import torch

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible, running
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict

from . import network


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The network of a checkpoint, ready to run in a task bundle."""
    contract = checkpoint.contract
    made = running.filled(network.of_contract(contract), checkpoint)
    present, every = made.history - 1, int(contract.settings["every"])
    noise = running.Noise(int(contract.settings["seed"]))

    def targets(inputs: Fields, step: int) -> np.ndarray:
        random = noise.at(inputs, step)
        with reproducible.one_thread(), torch.inference_mode():
            window = made.sample(running.tensors(inputs), torch.randn(1, *made.shape, generator=random))[0]
        return running.targets(contract, window[present : present + every])

    return targets
