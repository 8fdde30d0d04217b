"""The ACT network: action chunks from a conditional variational transformer (Zhao et al. 2023, arXiv 2304.13705).

In training, an encoder maps the demonstrated chunk to a latent, the "style"; the transformer predicts the chunk from
that latent and the observation. At run time the latent is 0. Blocks use pre-normalisation, which trains without a
warm-up of thousands of steps, and a small convolutional network encodes images instead of a pretrained ResNet-18; as
there, one network encodes those of all cameras.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.learning.eye import Eyes
from dextera_build.learning.samples import Batch
from dextera_build.policy import features


@dataclass(frozen=True)
class Sizes:
    """Sizes of the network; with the widths of its inputs they determine the shape of every weight."""

    chunk: int = 20
    """Steps predicted at once."""
    width: int = 96
    """Features of a token."""
    heads: int = 4
    """Attention heads; a divisor of `width`."""
    style_layers: int = 1
    """Blocks of the style encoder, used only in training."""
    encoder_layers: int = 2
    """Blocks over the observation's tokens."""
    decoder_layers: int = 2
    """Blocks over the chunk's tokens."""
    latent: int = 8
    """Size of the latent."""
    feed_forward: int = 0
    """Features between the layers of a block's perceptron; 0: twice the width."""
    located: int = 0
    """Numbers in the pose and joints of the task's object, an auxiliary target of image policies."""

    @classmethod
    def of(cls, settings: Mapping[str, float | int | str | bool]) -> Sizes:
        """The sizes among the settings of a contract; other settings are ignored."""
        return cls(**{name: int(settings[name]) for name in cls.__dataclass_fields__ if name in settings})


class Attention(nn.Module):
    """Multi-head attention of (B, N, W) queries to (B, M, W) tokens."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, queries: Tensor, tokens: Tensor, keep: Tensor | None = None) -> Tensor:
        """(B, N, W); `keep` (B, M) is false for absent tokens."""
        batch, count, width = queries.shape
        q = self.query(queries).view(batch, count, self.heads, -1).transpose(1, 2)
        pair = self.key_value(tokens).view(batch, tokens.shape[1], 2, self.heads, -1).permute(2, 0, 3, 1, 4)
        mask = None if keep is None else keep[:, None, None, :]
        mixed = F.scaled_dot_product_attention(q, pair[0], pair[1], attn_mask=mask)
        out: Tensor = self.out(mixed.transpose(1, 2).reshape(batch, count, width))
        return out


class Block(nn.Module):
    """Self-attention, optional attention to a memory, and a two-layer perceptron, all residual."""

    def __init__(self, sizes: Sizes, dropout: float, *, memory: bool = False) -> None:
        super().__init__()
        width, heads, hidden = sizes.width, sizes.heads, sizes.feed_forward or 2 * sizes.width
        self.norm_self = nn.LayerNorm(width)
        self.attend_self = Attention(width, heads)
        self.norm_memory = nn.LayerNorm(width) if memory else None
        self.attend_memory = Attention(width, heads) if memory else None
        self.norm_mlp = nn.LayerNorm(width)
        self.mlp = nn.Sequential(nn.Linear(width, hidden), nn.GELU(), nn.Linear(hidden, width))
        self.drop = nn.Dropout(dropout)

    def forward(self, tokens: Tensor, memory: Tensor | None = None, keep: Tensor | None = None) -> Tensor:
        """(B, N, W) tokens after the block."""
        normed = self.norm_self(tokens)
        tokens = tokens + self.drop(self.attend_self(normed, normed, keep))
        if self.norm_memory is not None and self.attend_memory is not None and memory is not None:
            tokens = tokens + self.drop(self.attend_memory(self.norm_memory(tokens), memory))
        out: Tensor = tokens + self.drop(self.mlp(self.norm_mlp(tokens)))
        return out


class Act(nn.Module):
    """The policy network and, for training, its style encoder.

    Args:
        sizes: Sizes of the network.
        contract: Inputs and outputs of the policy.
        dropout: Share of the features of a block that are left out in training.
    """

    def __init__(self, sizes: Sizes, contract: PolicyContract, dropout: float = 0.0) -> None:
        super().__init__()
        inputs = {channel.name: features.tokens(channel) for channel in contract.vectors}
        actions, looks = len(contract.action.names), len(contract.seen)
        width = sizes.width
        self.latent = sizes.latent
        self.embed = nn.ModuleDict({name: nn.Linear(features, width) for name, (_, features) in inputs.items()})
        count = 1 + sum(tokens for tokens, _ in inputs.values())
        self.place = nn.Parameter(torch.randn(count, width) * 0.02)
        self.eyes = Eyes(contract, width, shared=True) if looks else None
        self.locate = nn.Linear(looks * width, sizes.located) if looks and sizes.located else None
        self.embed_latent = nn.Linear(sizes.latent, width)
        self.encoder = nn.ModuleList(Block(sizes, dropout) for _ in range(sizes.encoder_layers))
        self.norm_memory = nn.LayerNorm(width)
        self.steps = nn.Parameter(torch.randn(sizes.chunk, width) * 0.02)
        self.decoder = nn.ModuleList(Block(sizes, dropout, memory=True) for _ in range(sizes.decoder_layers))
        self.norm_out = nn.LayerNorm(width)
        self.head = nn.Linear(width, actions)
        self.style_action = nn.Linear(actions, width)
        self.style_place = nn.Parameter(torch.randn(count + sizes.chunk, width) * 0.02)
        self.style = nn.ModuleList(Block(sizes, dropout) for _ in range(sizes.style_layers))
        self.style_out = nn.Linear(width, 2 * sizes.latent)

    def forward(self, inputs: Mapping[str, Tensor], latent: Tensor | None = None, seen: Tensor | None = None) -> Tensor:
        """(B, C, A) normalised actions; without a latent, the mean 0 is used.

        Args:
            inputs: Channel -> (B, tokens, features) float32; those of a camera as `Eyes` takes them.
            latent: (B, Z) style.
            seen: (B, S, W) tokens of the cameras, if `see` has already computed them.
        """
        tokens = self._tokens(inputs)
        if latent is None:
            latent = tokens.new_zeros(tokens.shape[0], self.latent)
        tokens = torch.cat([self.embed_latent(latent)[:, None], tokens], dim=1) + self.place
        seen = self.see(inputs) if seen is None else seen
        if seen is not None:
            tokens = torch.cat([tokens, seen], dim=1)
        for block in self.encoder:
            tokens = block(tokens)
        memory = self.norm_memory(tokens)
        chunk = self.steps.expand(tokens.shape[0], -1, -1)
        for block in self.decoder:
            chunk = block(chunk, memory)
        out: Tensor = self.head(self.norm_out(chunk))
        return out

    def see(self, inputs: Mapping[str, Tensor]) -> Tensor | None:
        """(B, S, W) tokens of the channels of cameras, or None for a policy without any."""
        return None if self.eyes is None else self.eyes(inputs)

    def encode(self, inputs: Mapping[str, Tensor], actions: Tensor, keep: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance, (B, Z) each, of the style of a demonstrated chunk.

        Args:
            inputs: As in `forward`; what the camera gives is ignored.
            actions: (B, C, A) normalised.
            keep: (B, C), false for steps after the episode's end.
        """
        tokens = self._tokens(inputs)
        first = tokens.new_zeros(tokens.shape[0], 1, tokens.shape[2])
        tokens = torch.cat([first, tokens, self.style_action(actions)], dim=1) + self.style_place
        there = keep.new_ones(len(keep), tokens.shape[1] - keep.shape[1])
        mask = torch.cat([there, keep], dim=1)
        for block in self.style:
            tokens = block(tokens, keep=mask)
        mean, log_variance = self.style_out(tokens[:, 0]).chunk(2, dim=-1)
        return mean, log_variance

    def _tokens(self, inputs: Mapping[str, Tensor]) -> Tensor:
        batch = len(next(iter(inputs.values())))
        none = self.place.new_zeros(batch, 0, self.place.shape[1])  # a policy may take nothing but pictures
        return torch.cat([none, *(layer(inputs[name]) for name, layer in self.embed.items())], dim=1)


def loss_of(network: Act, batch: Batch, noise: Tensor, kl_weight: float) -> tuple[Tensor, Tensor]:
    """(loss, L1 part): mean absolute error over valid steps, and the latent's divergence from N(0, 1).

    An image policy also predicts the object's pose. Without it, the policy infers the goal of a motion from the robot's
    joints, which works in demonstrations but not in closed loop.

    Args:
        network: The network.
        batch: Samples.
        noise: (B, Z) standard normal sample for the latent.
        kl_weight: Weight of the divergence.
    """
    mean, log_variance = network.encode(batch.inputs, batch.actions, batch.keep)
    latent = mean + (0.5 * log_variance).exp() * noise
    seen = network.see(batch.inputs)
    error = (network(batch.inputs, latent, seen) - batch.actions).abs().mean(dim=-1)
    l1 = (error * batch.keep).sum() / batch.keep.sum()
    kl = -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).sum(dim=-1).mean()
    loss = l1 + kl_weight * kl
    if network.locate is not None and seen is not None and batch.places is not None:
        loss = loss + (network.locate(seen.flatten(1)) - batch.places).abs().mean()
    return loss, l1


def of_contract(contract: PolicyContract, seed: int = 0, dropout: float = 0.0) -> Act:
    """Build the network of a contract, with initial weights that depend only on `seed`."""
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        return Act(Sizes.of(contract.settings), contract, dropout)
