"""What `policy.py` of imitation learning algorithms share: weights, inputs and actions of a network at run time."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build import digest
from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.learning import weights
from dextera_build.learning.samples import as_seen
from dextera_build.policy import cameras
from dextera_build.policy.features import Fields

Network = TypeVar("Network", bound=nn.Module)
ROUNDED = 1e-3
"""Step of normalised inputs below which two episodes begin alike."""


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


class Noise:
    """Noise of a policy that draws: other noise in each episode and at each of its steps, the same if it is repeated.

    What an episode begins with tells it from others, so that a policy behind an address or on a robot draws as in a
    trial. Numbers count to `ROUNDED`, because processors differ by less.

    Args:
        seed: Seed of the policy.
    """

    def __init__(self, seed: int) -> None:
        self._seed, self._episode = seed, ""

    def at(self, inputs: Fields, step: int) -> torch.Generator:
        """The generator of a step.

        Args:
            inputs: Inputs of the policy, normalised.
            step: Steps since the start of the episode.
        """
        if step == 0:
            self._episode = digest.of_value([[name, _rounded(inputs[name])] for name in sorted(inputs)])
        key = digest.of_value([self._seed, self._episode, step])
        return torch.Generator().manual_seed(int(key[:16], 16) >> 1)


def _rounded(samples: np.ndarray) -> str:
    """The digest of samples, of numbers to `ROUNDED`."""
    whole = samples if samples.dtype == np.uint8 else np.rint(samples / ROUNDED).astype(np.int64)
    return digest.of_bytes(whole.tobytes())


def targets(contract: PolicyContract, actions: Tensor) -> np.ndarray:
    """Joint targets (C, A) float64 [rad] of normalised actions (C, A)."""
    mean, scale = (np.array(part, np.float64) for part in (contract.action.mean, contract.action.scale))
    return np.asarray(actions.numpy().astype(np.float64) * scale + mean)
