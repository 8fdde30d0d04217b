"""learn.bc_rnn with torch on one core."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from dextera_build.learning import training
from dextera_build.learning.samples import Batch, Window
from dextera_build.rule import Backend, Context, Options

from . import network

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations
    from dextera_build.learning.trained import Trained

    from .bc_rnn_options import BcRnnOptions

BACKEND = Backend(
    summary="torch on one core, deterministic; resumes after an interruption",
    profiles=("cpu",),
    packages=("torch", "safetensors"),
    extra="learn",
)


def train(ctx: Context, data: Demonstrations, common: BcRnnOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    return training.train(ctx, data, common, Learner(data, common))


class Learner:
    """The network of BC-RNN-GMM and its loss, in the loop of all imitation learning."""

    betas = (0.9, 0.999)

    def __init__(self, data: Demonstrations, options: BcRnnOptions) -> None:
        self.network = network.of_contract(data.contract, options.seed)
        self.window = Window(range(options.horizon), range(options.horizon))

    def loss(self, network_: network.BcRnn, batch: Batch, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """As `network.loss_of`."""
        return network.loss_of(network_, batch)

    def predicted(self, network_: network.BcRnn, batch: Batch) -> Tensor:
        """The likeliest actions (B, T, A) of windows that begin without memory."""
        modes: network.Modes = network_(batch.inputs)[0]
        return modes.likeliest()
