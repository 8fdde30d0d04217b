"""The BC-RNN-GMM network: an LSTM that gives a mixture of Gaussians (Mandlekar et al. 2021, arXiv 2108.03298).

The original bounds the means of the Gaussians by tanh, because its actions are scaled to -1..1. Here actions are
normalised by their mean and standard deviation and have no bound, so means are linear in the state of the LSTM. That
state is within -1..1, so means are bounded for any input, and the policy keeps targets within joint limits. Each camera
has an encoder of its own, as in robomimic.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.learning.eye import Eyes
from dextera_build.learning.samples import Batch
from dextera_build.policy import features

SEEN = 64
"""Features of each channel of a camera; robomimic's."""

State = tuple[Tensor, Tensor]
"""Hidden state and cell (L, B, H) of the LSTM after a step."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the network; with the widths of its inputs they determine the shape of every weight."""

    hidden: int = 128
    """Size of the state of an LSTM layer."""
    layers: int = 2
    """LSTM layers."""
    modes: int = 5
    """Gaussians in the distribution of an action."""
    least_std: float = 0.1
    """Least standard deviation of a Gaussian, in those of the actions."""
    located: int = 0
    """Numbers in the pose and joints of the task's object, an auxiliary target of image policies."""

    @classmethod
    def of(cls, settings: Mapping[str, float | int | str | bool]) -> Sizes:
        """The sizes among the settings of a contract; other settings are ignored."""
        known = asdict(cls())
        return cls(**{name: type(known[name])(settings[name]) for name in known if name in settings})


@dataclass(frozen=True)
class Modes:
    """A mixture of M Gaussians over each action, independent between its A components."""

    logits: Tensor
    """Logarithms of the weights, up to a constant (B, T, M)."""
    means: Tensor
    """Normalised actions (B, T, M, A)."""
    stds: Tensor
    """Standard deviations (B, T, M, A)."""

    def log_likelihood(self, actions: Tensor) -> Tensor:
        """Logarithm of the density (B, T) at actions (B, T, A)."""
        off = (actions[..., None, :] - self.means) / self.stds
        each = -0.5 * off.square() - self.stds.log() - 0.5 * math.log(2 * math.pi)
        return torch.logsumexp(self.logits.log_softmax(dim=-1) + each.sum(dim=-1), dim=-1)

    def likeliest(self) -> Tensor:
        """Means (B, T, A) of the Gaussians of greatest weight."""
        return self.of(self.logits.argmax(dim=-1))

    def of(self, chosen: Tensor) -> Tensor:
        """Means (B, T, A) of the Gaussians with numbers (B, T)."""
        return self.means.take_along_dim(chosen[..., None, None], dim=-2).squeeze(-2)


class BcRnn(nn.Module):
    """The policy network.

    Args:
        sizes: Sizes of the network.
        contract: Inputs and outputs of the policy.
    """

    def __init__(self, sizes: Sizes, contract: PolicyContract) -> None:
        super().__init__()
        inputs = {channel.name: math.prod(features.tokens(channel)) for channel in contract.vectors}
        actions, seen = len(contract.action.names), SEEN * len(contract.seen)
        self._inputs, self._shape, self._least_std = tuple(inputs), (sizes.modes, actions), sizes.least_std
        self.eyes = Eyes(contract, SEEN) if seen else None
        self.locate = nn.Linear(seen, sizes.located) if seen and sizes.located else None
        taken = sum(inputs.values()) + seen
        self.lstm = nn.LSTM(taken, sizes.hidden, sizes.layers, batch_first=True)
        self.means = nn.Linear(sizes.hidden, sizes.modes * actions)
        self.spreads = nn.Linear(sizes.hidden, sizes.modes * actions)
        self.logits = nn.Linear(sizes.hidden, sizes.modes)

    def forward(
        self, inputs: Mapping[str, Tensor], state: State | None = None, seen: Tensor | None = None
    ) -> tuple[Modes, State]:
        """The distribution of the action at each of T steps, and the state after the last.

        Args:
            inputs: Channel -> (B, T, tokens, features) float32; those of a camera as `Eyes` takes them.
            state: The state before the first step; None: nothing was seen yet.
            seen: (B, T, S) features of what the camera gives, if `see` has already computed them.
        """
        parts = [inputs[name].flatten(2) for name in self._inputs]
        seen = self.see(inputs) if seen is None else seen
        read, state = self.lstm(torch.cat(parts if seen is None else [*parts, seen], dim=-1), state)
        shape = (*read.shape[:2], *self._shape)
        # A narrow Gaussian tells what bfloat16 rounds away.
        with torch.autocast(read.device.type, enabled=False):
            exact = read.float()
            stds = F.softplus(self.spreads(exact).view(shape)) + self._least_std
            return Modes(self.logits(exact), self.means(exact).view(shape), stds), state

    def see(self, inputs: Mapping[str, Tensor]) -> Tensor | None:
        """(B, T, S) features of what the camera gives, or None for a policy without a camera."""
        return None if self.eyes is None else self.eyes(inputs).flatten(2)


def loss_of(network: BcRnn, batch: Batch) -> tuple[Tensor, Tensor]:
    """(loss, negative log-likelihood per component of an action), the mean over valid steps.

    An image policy also predicts the object's pose at the first step, for the reason given in `learn.act`'s network.

    Args:
        network: The network.
        batch: Samples with as many observed as demonstrated steps.
    """
    seen = network.see(batch.inputs)
    modes, _ = network(batch.inputs, seen=seen)
    likely = (modes.log_likelihood(batch.actions) * batch.keep).sum() / batch.keep.sum()
    loss = unlikely = -likely / batch.actions.shape[-1]
    if network.locate is not None and seen is not None and batch.places is not None:
        loss = loss + (network.locate(seen[:, 0]) - batch.places).abs().mean()
    return loss, unlikely


def of_contract(contract: PolicyContract, seed: int = 0) -> BcRnn:
    """Build the network of a contract, with initial weights that depend only on `seed`."""
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        return BcRnn(Sizes.of(contract.settings), contract)
