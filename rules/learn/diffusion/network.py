"""The network of Diffusion Policy: it tells a window of actions, or the noise in it, from what was observed.

The window begins at the oldest observed step. Vector channels of each observed step are the condition as they are;
what a camera gives is encoded by small networks instead of a ResNet-18, as there by one of its own for each camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.learning.eye import Eyes
from dextera_build.learning.samples import Batch
from dextera_build.policy import features

from . import schedule
from .transformer import Transformer
from .unet import Unet

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations

SEEN = 64
"""Features of each channel of a camera."""


class Denoiser(nn.Module):
    """The network, the range of its actions and its levels of noise.

    Args:
        contract: Inputs, outputs and settings of the policy.
        dropout: Dropout of the transformer in training.
    """

    centre: Tensor
    reach: Tensor
    share: Tensor

    def __init__(self, contract: PolicyContract, dropout: float = 0.0) -> None:
        super().__init__()
        settings, actions = contract.settings, len(contract.action.names)
        self.history, self.passes = int(settings["history"]), int(settings["denoisings"])
        # Checkpoints from before the choice tell the noise.
        self.told = str(settings.get("predicts", "noise"))
        self.shape = (int(settings["horizon"]), actions)
        self.vectors = [channel.name for channel in contract.vectors]
        seen = SEEN * len(contract.seen)
        observed = sum(count * size for count, size in map(features.tokens, contract.vectors)) + seen
        self.eyes = Eyes(contract, SEEN) if seen else None
        self.locate = nn.Linear(seen, int(settings["located"])) if seen and settings["located"] else None
        self.body = _body(settings, actions, observed, dropout)
        self.register_buffer("centre", torch.zeros(actions))
        self.register_buffer("reach", torch.ones(actions))
        self.register_buffer("share", schedule.shares(int(settings["noise_levels"])), persistent=False)

    def fit(self, data: Demonstrations) -> None:
        """Take the range of the actions from the training episodes."""
        shown = data.actions[np.concatenate(data.train_rows)]
        low, high = (torch.from_numpy(each) for each in (shown.min(axis=0), shown.max(axis=0)))
        self.centre = (low + high) / 2
        # Normalised actions are in standard deviations, of which a range has any number, while predictions are clipped:
        # the range is mapped to -1 to 1. Half a range is never less than one standard deviation; it is here only for
        # components that hardly move, whose scale is the floor of the normalisation instead.
        self.reach = ((high - low) / 2).clamp(min=1.0)

    def observe(self, inputs: Mapping[str, Tensor]) -> tuple[Tensor, Tensor | None]:
        """Features (B, H, D) of the observed steps, and those (B, S) of what the camera gives at present alone.

        Args:
            inputs: Channel -> (B, H, tokens, features); those of a camera as `Eyes` takes them. If only the present
                step is observed, without the axis H.
        """
        batch = len(next(iter(inputs.values())))
        parts = [inputs[name].reshape(batch, self.history, -1) for name in self.vectors]
        if self.eyes is None:
            return torch.cat(parts, dim=2), None
        seen = self.eyes(inputs).reshape(batch, self.history, -1)
        return torch.cat([*parts, seen], dim=2), seen[:, -1]

    def forward(self, actions: Tensor, levels: Tensor, observed: Tensor) -> Tensor:
        """The actions (B, T, A) without noise, or the noise, of actions in -1 to 1 with noise of levels (B,) int64."""
        made: Tensor = self.body(actions, levels, observed)
        return made

    def sample(self, inputs: Mapping[str, Tensor], noise: Tensor) -> Tensor:
        """Normalised actions (B, T, A) from noise of the same shape."""
        observed, _ = self.observe(inputs)

        def told(actions: Tensor, level: int) -> Tensor:
            made: Tensor = self(actions, torch.full((len(actions),), level, device=actions.device), observed)
            return made

        return schedule.denoised(noise, self.share, self.passes, told, self.told) * self.reach + self.centre


def loss_of(network: Denoiser, batch: Batch, noise: Tensor, levels: Tensor, held: int) -> tuple[Tensor, Tensor]:
    """(loss, its part of the actions): mean squared error of what is told, over the steps that `trained_on` keeps.

    A policy with pictures also predicts the object's pose, as that of `learn.act` does.

    Args:
        network: The network.
        batch: Samples.
        noise: (B, T, A) standard normal.
        levels: Level of noise (B,) int64 of each sample.
        held: Steps after the end of an episode that are learned.
    """
    observed, seen = network.observe(batch.inputs)
    actions = (batch.actions - network.centre) / network.reach
    mixed = schedule.noised(actions, noise, network.share[levels])
    keep = trained_on(batch.keep, held)
    wanted = noise if network.told == "noise" else actions
    error = (network(mixed, levels, observed) - wanted).square().mean(dim=-1)
    loss = found = (error * keep).sum() / keep.sum()
    if network.locate is not None and seen is not None and batch.places is not None:
        loss = loss + (network.locate(seen) - batch.places).abs().mean()
    return loss, found


def trained_on(keep: Tensor, held: int) -> Tensor:
    """Steps (B, T) that are learned: those before the end of the episode, and `held` after it.

    Before the first step its action is repeated, and after the last that one: the robot holds its targets. A policy
    executes several steps without looking, some of them after the end, so it must have learned to hold.

    Args:
        keep: (B, T), false for steps outside the episode.
        held: Steps after the end.
    """
    steps = torch.arange(keep.shape[1], device=keep.device)
    return steps <= (steps * keep).amax(dim=1, keepdim=True) + held


def of_contract(contract: PolicyContract, seed: int = 0, dropout: float = 0.0) -> Denoiser:
    """Build the network of a contract, with initial weights that depend only on `seed`."""
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        return Denoiser(contract, dropout)


def _body(settings: Mapping[str, float | int | str | bool], actions: int, observed: int, dropout: float) -> nn.Module:
    size = {name: int(settings[name]) for name in ("horizon", "history", "width", "levels", "layers", "heads")}
    if settings["network"] == "unet":
        return Unet(actions, size["width"], size["levels"], size["history"] * observed)
    return Transformer(
        actions,
        size["horizon"],
        size["width"],
        size["layers"],
        size["heads"],
        history=size["history"],
        observed=observed,
        dropout=dropout,
    )
