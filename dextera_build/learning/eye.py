"""A small image encoder for policies."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class Eye(nn.Module):
    """Image encoder: convolutions, then the mean position of each feature (spatial softmax, Levine et al. 2016).

    It locates features to a fraction of a pixel from few demonstrations, which patches of a coarse map would have to
    learn; the whole image becomes one token.
    """

    def __init__(self, width: int, points: int = 32) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.Conv2d(3, 16, 5, stride=2, padding=2), nn.GroupNorm(4, 16), nn.ReLU()),
            *(nn.Conv2d(16, 32, 3, stride=2, padding=1), nn.GroupNorm(4, 32), nn.ReLU()),
            *(nn.Conv2d(32, 32, 3, padding=1), nn.GroupNorm(4, 32), nn.ReLU()),
            nn.Conv2d(32, points, 1),
        )
        self.out = nn.Sequential(nn.Linear(2 * points, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, pixels: Tensor) -> Tensor:
        """(B, 1, W) token of (B, 3, H, W) pixels in -1 to 1."""
        maps = self.layers(pixels)
        shares = maps.flatten(2).softmax(dim=-1).view_as(maps)
        rows, columns = (torch.linspace(-1.0, 1.0, size) for size in maps.shape[2:])
        places = torch.cat([shares.sum(dim=3) @ rows, shares.sum(dim=2) @ columns], dim=1)
        out: Tensor = self.out(places)
        return out[:, None]
