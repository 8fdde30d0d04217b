"""learn.act with torch on one core."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from dextera_build.learning import reproducible, training
from dextera_build.learning.samples import Batch, Window
from dextera_build.rule import Backend, Context, Options

from . import network

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations
    from dextera_build.learning.trained import Trained

    from .act_options import ActOptions

BACKEND = Backend(
    summary="torch on one core, deterministic; resumes after an interruption",
    profiles=("cpu",),
    packages=("torch", "safetensors"),
    extra="learn",
)


def train(ctx: Context, data: Demonstrations, common: ActOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    return training.train(ctx, data, common, Learner(data, common))


class Learner:
    """The network of ACT and its loss, in the loop of all imitation learning."""

    betas = (0.9, 0.999)

    def __init__(self, data: Demonstrations, options: ActOptions) -> None:
        self.network = network.of_contract(data.contract, options.seed, options.dropout)
        self.window = Window(range(options.chunk))
        self._latent, self._kl_weight, self._dropout = options.latent, options.kl_weight, options.dropout

    def loss(self, network_: network.Act, batch: Batch, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """As `network.loss_of`, with a drawn latent."""
        device = batch.actions.device
        noise = torch.randn(len(batch.actions), self._latent, generator=random).to(device)
        with reproducible.drawn(random, device) if self._dropout else nullcontext():
            return network.loss_of(network_, batch, noise, self._kl_weight)

    def predicted(self, network_: network.Act, batch: Batch) -> Tensor:
        """The chunks (B, C, A) of the mean latent."""
        made: Tensor = network_(batch.inputs)
        return made
