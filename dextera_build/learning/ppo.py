"""The network of PPO policies; `dextera_build.sim.control.steering` interprets its decisions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build.artifacts.policy import Channel, PolicyContract
from dextera_build.policy.features import Fields, tokens


class Actor(nn.Module):
    """Maps numbers (B, N) to decisions (B, M): a multilayer perceptron with tanh.

    Args:
        numbers: Size of the input.
        width: Features of a layer.
        layers: Number of layers.
        decisions: Size of the output.
    """

    def __init__(self, numbers: int, width: int, layers: int, decisions: int) -> None:
        super().__init__()
        sizes = [numbers, *[width] * layers]
        parts: list[nn.Module] = []
        for before, after in pairwise(sizes):
            parts += [nn.Linear(before, after), nn.Tanh()]
        self.body = nn.Sequential(*parts)
        self.head = nn.Linear(sizes[-1], decisions)

    def forward(self, numbers: Tensor) -> Tensor:
        """Decisions; -1 to 1 is one step down or up, and values beyond are clipped."""
        decided: Tensor = self.head(self.body(numbers))
        return decided


def of_contract(contract: PolicyContract) -> Actor:
    """Build the network of a contract, with uninitialized weights."""
    settings = contract.settings
    return Actor(
        sum(int(np.prod(tokens(channel))) for channel in contract.inputs) + int(settings["places"]),
        int(settings["width"]),
        int(settings["layers"]),
        int(settings["decisions"]),
    )


def flat(inputs: Fields, channels: tuple[Channel, ...]) -> np.ndarray:
    """Concatenate the channels of inputs for the network, (B, N) float32."""
    parts = [inputs[channel.name].reshape(len(inputs[channel.name]), -1) for channel in channels]
    return np.concatenate(parts, axis=1, dtype=np.float32)


def raw(inputs: Fields, channels: tuple[Channel, ...], name: str) -> np.ndarray:
    """The single sample of a plain channel as observed, (K,) float64."""
    channel = next(channel for channel in channels if channel.name == name)
    sample = inputs[name].reshape(-1).astype(np.float64)
    return sample * np.array(channel.scale) + np.array(channel.mean) if channel.scale else sample


def decide(network: Actor, numbers: np.ndarray) -> np.ndarray:
    """Decisions (M,) for one input (1, N)."""
    decided: np.ndarray = network(torch.from_numpy(numbers))[0].numpy()
    return decided
