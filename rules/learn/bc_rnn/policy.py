"""Runs policies of learn.bc_rnn: one action of the network per step [rad]."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible, running
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict

from . import network


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The network of a checkpoint, ready to run in a task bundle.

    The original draws from Gaussians of the least standard deviation at run time; here it is the mean.
    """
    contract = checkpoint.contract
    made = running.filled(network.of_contract(contract), checkpoint)
    horizon, noise = int(contract.settings["horizon"]), running.Noise(int(contract.settings["seed"]))
    drawn = contract.settings["pick"] == "drawn"
    state: network.State | None = None

    def targets(inputs: Fields, step: int) -> np.ndarray:
        nonlocal state
        if step % horizon == 0:
            state = None
        random = noise.at(inputs, step)
        with reproducible.one_thread(), torch.inference_mode():
            seen = {name: each[:, None] for name, each in running.tensors(inputs).items()}
            modes, state = made(seen, state)
            action = modes.of(_drawn(modes.logits, random)) if drawn else modes.likeliest()
        return running.targets(contract, action[0])

    return targets


def _drawn(logits: Tensor, random: torch.Generator) -> Tensor:
    """Number of a mode (1, 1), drawn by weight."""
    return torch.multinomial(logits[0].softmax(dim=-1), 1, generator=random)
