"""The network of PPO policies; `dextera_build.sim.control.steering` interprets its decisions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.policy.contract import PRIVILEGED
from dextera_build.policy.features import tokens


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
        sum(int(np.prod(tokens(channel))) for channel in contract.inputs)
        + int(settings["places"])
        + int(settings.get(PRIVILEGED, 0)),
        int(settings["width"]),
        int(settings["layers"]),
        int(settings["decisions"]),
    )


def decide(network: Actor, numbers: np.ndarray) -> np.ndarray:
    """Decisions (M,) for one input (1, N)."""
    decided: np.ndarray = network(torch.from_numpy(numbers))[0].numpy()
    return decided
