"""What `policy.py` of imitation learning algorithms share: weights, inputs and actions of a network at run time."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.learning import weights
from dextera_build.learning.samples import as_seen
from dextera_build.policy import cameras
from dextera_build.policy.features import Fields

Network = TypeVar("Network", bound=nn.Module)


def filled(network: Network, checkpoint: Checkpoint) -> Network:
    """The network with the weights of a checkpoint, ready to run.

    Raises:
        RuleError: The weights are corrupt.
    """
    weights.fill(network, weights.from_bytes(checkpoint.weights))
    return network.eval()


def tensors(inputs: Fields) -> dict[str, Tensor]:
    """Inputs of a policy as a network takes them; see `samples.as_seen` for those of a camera."""
    made = {name: torch.from_numpy(np.ascontiguousarray(field)) for name, field in inputs.items()}
    return {name: as_seen(name, each) if cameras.is_seen(name) else each for name, each in made.items()}


def targets(contract: PolicyContract, actions: Tensor) -> np.ndarray:
    """Joint targets (C, A) float64 [rad] of normalised actions (C, A)."""
    mean, scale = (np.array(part, np.float64) for part in (contract.action.mean, contract.action.scale))
    return np.asarray(actions.numpy().astype(np.float64) * scale + mean)
