"""Runs policies of learn.ppo: joint targets that the network's decisions lead to [rad]."""

from __future__ import annotations

import numpy as np
import torch

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible, weights
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict
from dextera_build.sim.control.steering import Steering

from . import network


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The network of a checkpoint, ready to run in a task bundle."""
    contract = checkpoint.contract
    made = network.of_contract(contract)
    weights.fill(made, weights.from_bytes(checkpoint.weights))
    made.eval()
    steering = Steering(bundle.robot, contract)

    def targets(inputs: Fields, step: int) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            decision = network.decide(made, steering.numbers(inputs))
        return steering.steered(decision, inputs)

    return targets
