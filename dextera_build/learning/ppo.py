"""The network of reinforced policies; its decisions are interpreted by `dextera_build.sim.control.steering`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build.artifacts.policy import Channel, PolicyContract
from dextera_build.policy.features import Fields, tokens


class Actor(nn.Module):
    """Numbers (B, N) to decisions (B, M): layers with tanh between them.

    Args:
        numbers: Size of an input.
        width: Features of a layer.
        layers: How many layers.
        decisions: Size of an output.
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
        """Decisions; -1 to 1 is one step down or up, and what lies beyond counts as that."""
        decided: Tensor = self.head(self.body(numbers))
        return decided


def of_contract(contract: PolicyContract) -> Actor:
    """The network that a contract describes, with weights still to be filled in."""
    settings = contract.settings
    return Actor(
        sum(int(np.prod(tokens(channel))) for channel in contract.inputs) + int(settings["places"]),
        int(settings["width"]),
        int(settings["layers"]),
        int(settings["decisions"]),
    )


def flat(inputs: Fields, channels: tuple[Channel, ...]) -> np.ndarray:
    """Inputs as the network takes them, (B, N) float32: channel after channel."""
    parts = [inputs[channel.name].reshape(len(inputs[channel.name]), -1) for channel in channels]
    return np.concatenate(parts, axis=1, dtype=np.float32)


def raw(inputs: Fields, channels: tuple[Channel, ...], name: str) -> np.ndarray:
    """The one sample of a plain channel as it was observed, (K,) float64."""
    channel = next(channel for channel in channels if channel.name == name)
    sample = inputs[name].reshape(-1).astype(np.float64)
    return sample * np.array(channel.scale) + np.array(channel.mean) if channel.scale else sample


def decide(network: Actor, numbers: np.ndarray) -> np.ndarray:
    """Decisions (M,) for one input (1, N)."""
    decided: np.ndarray = network(torch.from_numpy(numbers))[0].numpy()
    return decided
