"""learn.diffusion with torch on one core."""

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

    from .diffusion_options import DiffusionOptions

BACKEND = Backend(
    summary="torch on one core, deterministic; resumes after an interruption",
    profiles=("cpu",),
    packages=("torch", "safetensors"),
    extra="learn",
)


def train(ctx: Context, data: Demonstrations, common: DiffusionOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    return training.train(ctx, data, common, Learner(data, common))


class Learner:
    """The network that denoises actions and its loss, in the loop of all imitation learning."""

    betas = (0.95, 0.999)

    def __init__(self, data: Demonstrations, options: DiffusionOptions) -> None:
        self.network = network.of_contract(data.contract, options.seed, options.dropout)
        self.network.fit(data)
        first = 1 - options.history
        self.window = Window(range(first, first + options.horizon), range(first, 1))
        self._held, self._levels, self._dropout = options.every - 1, options.noise_levels, options.dropout

    def loss(self, network_: network.Denoiser, batch: Batch, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """As `network.loss_of`, with drawn noise."""
        device = batch.actions.device
        noise = torch.randn(batch.actions.shape, generator=random).to(device)
        levels = torch.randint(self._levels, (len(noise),), generator=random).to(device)
        with reproducible.drawn(random, device) if self._dropout else nullcontext():
            return network.loss_of(network_, batch, noise, levels, self._held)

    def predicted(self, network_: network.Denoiser, batch: Batch) -> Tensor:
        """The windows (B, T, A) from the same noise every time."""
        noise = torch.randn(batch.actions.shape, generator=torch.Generator().manual_seed(0))
        return network_.sample(batch.inputs, noise.to(batch.actions.device))
