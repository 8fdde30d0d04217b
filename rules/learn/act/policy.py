"""Runs policies of learn.act: action chunks of the network [rad]."""

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

    def targets(inputs: Fields, step: int) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            return running.targets(contract, made(running.tensors(inputs))[0])

    return targets
