"""A transformer over the steps of an action window, which attends to observed steps (Chi et al. 2023).

Every step of the window is a token; the level of noise and each observed step are the memory. In the original a step
attends only to steps that are not after it. Then the beginning of a window does not know what its end settles for: of
two ways to do something, a fifth of the windows of eight steps begins with one and ends with the other, even if the
network errs in nothing (ten denoisings). So here all steps attend to all.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .schedule import waves


class Transformer(nn.Module):
    """The noise in actions.

    Args:
        actions: Components of an action.
        horizon: Steps of the window.
        width: Features of a token.
        layers: Blocks.
        heads: Attention heads; a divisor of `width`.
        history: Observed steps.
        observed: Features of an observed step.
        dropout: Share of features that are left out in training.
    """

    def __init__(
        self,
        actions: int,
        horizon: int,
        width: int,
        layers: int,
        heads: int,
        history: int,
        observed: int,
        dropout: float,
    ) -> None:
        super().__init__()
        self.width = width
        self.embed, self.embed_observed = nn.Linear(actions, width), nn.Linear(observed, width)
        self.place = nn.Parameter(torch.randn(horizon, width) * 0.02)
        self.place_memory = nn.Parameter(torch.randn(1 + history, width) * 0.02)
        self.memory = nn.Sequential(nn.Linear(width, 4 * width), nn.Mish(), nn.Linear(4 * width, width))
        self.blocks = nn.ModuleList(
            nn.TransformerDecoderLayer(
                width, heads, 4 * width, dropout, activation="gelu", batch_first=True, norm_first=True
            )
            for _ in range(layers)
        )
        self.out = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, actions))

    def forward(self, actions: Tensor, levels: Tensor, observed: Tensor) -> Tensor:
        """The noise (B, T, A) in actions (B, T, A) at levels (B,), after observed steps (B, H, D)."""
        memory = torch.cat([waves(levels, self.width)[:, None], self.embed_observed(observed)], dim=1)
        memory = self.memory(memory + self.place_memory)
        tokens = self.embed(actions) + self.place
        for block in self.blocks:
            tokens = block(tokens, memory)
        made: Tensor = self.out(tokens)
        return made
