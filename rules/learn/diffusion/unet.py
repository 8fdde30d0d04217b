"""A one-dimensional U-Net over the steps of an action window, steered by a condition (Chi et al. 2023).

Convolutions over time, in levels that each halve the number of steps and double the features; on the way back every
level also sees what it had on the way down. The condition scales and shifts the features of every block (FiLM, Perez et
al. 2018).
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from .schedule import waves

KERNEL = 5
"""Steps that a convolution sees."""
GROUPS = 8
"""Groups of features that are normalised together; means over a batch would not go with averaged weights."""
LEVEL = 128
"""Features of the level of noise."""


def convolved(before: int, after: int) -> nn.Sequential:
    """A convolution over time, normalised, with a nonlinearity."""
    return nn.Sequential(nn.Conv1d(before, after, KERNEL, padding=KERNEL // 2), nn.GroupNorm(GROUPS, after), nn.Mish())


class Block(nn.Module):
    """Two convolutions, steered between them, and what came in."""

    def __init__(self, before: int, after: int, condition: int) -> None:
        super().__init__()
        self.first, self.second = convolved(before, after), convolved(after, after)
        self.steer = nn.Sequential(nn.Mish(), nn.Linear(condition, 2 * after))
        self.past = nn.Conv1d(before, after, 1) if before != after else nn.Identity()

    def forward(self, features: Tensor, condition: Tensor) -> Tensor:
        """(B, after, T) of (B, before, T) features and a (B, condition)."""
        scale, shift = self.steer(condition)[:, :, None].chunk(2, dim=1)
        # The scale is 1 plus what is learned, so that features pass unchanged at first.
        made: Tensor = self.second((1 + scale) * self.first(features) + shift) + self.past(features)
        return made


class Pair(nn.Module):
    """The two blocks of a level."""

    def __init__(self, before: int, after: int, condition: int) -> None:
        super().__init__()
        self.first, self.second = Block(before, after, condition), Block(after, after, condition)

    def forward(self, features: Tensor, condition: Tensor) -> Tensor:
        """(B, after, T) of (B, before, T) features and a (B, condition)."""
        made: Tensor = self.second(self.first(features, condition), condition)
        return made


class Unet(nn.Module):
    """The noise in actions.

    Args:
        actions: Components of an action.
        width: Features of the first level; each further level has twice as many.
        levels: Number of levels.
        observed: Features of all observed steps together.
    """

    def __init__(self, actions: int, width: int, levels: int, observed: int) -> None:
        super().__init__()
        self.level = nn.Sequential(nn.Linear(LEVEL, 4 * LEVEL), nn.Mish(), nn.Linear(4 * LEVEL, LEVEL))
        condition = LEVEL + observed
        sizes = [width * 2**level for level in range(levels)]
        self.down = nn.ModuleList(
            Pair(before, after, condition) for before, after in zip([actions, *sizes], sizes, strict=False)
        )
        self.shorter = nn.ModuleList(nn.Conv1d(size, size, 3, stride=2, padding=1) for size in sizes[:-1])
        self.middle = Pair(sizes[-1], sizes[-1], condition)
        self.up = nn.ModuleList(Pair(2 * before, after, condition) for before, after in pairwise(reversed(sizes)))
        self.longer = nn.ModuleList(
            nn.ConvTranspose1d(size, size, 4, stride=2, padding=1) for size in reversed(sizes[:-1])
        )
        self.out = nn.Sequential(convolved(width, width), nn.Conv1d(width, actions, 1))

    def forward(self, actions: Tensor, levels: Tensor, observed: Tensor) -> Tensor:
        """The noise (B, T, A) in actions (B, T, A) at levels (B,), after observed steps (B, H, D)."""
        condition = torch.cat([self.level(waves(levels, LEVEL)), observed.flatten(1)], dim=1)
        features, passed = actions.transpose(1, 2), list[Tensor]()
        for level, pair in enumerate(self.down):
            features = pair(features, condition)
            passed.append(features)
            features = self.shorter[level](features) if level < len(self.shorter) else features
        features = self.middle(features, condition)
        for pair, longer in zip(self.up, self.longer, strict=True):
            features = longer(pair(torch.cat([features, passed.pop()], dim=1), condition))
        made: Tensor = self.out(features).transpose(1, 2)
        return made
