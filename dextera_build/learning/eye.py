"""Small encoders of what cameras give: pictures, depth and points."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.policy import cameras

PLANES = {"rgb": 3, "depth": 2}
"""Term of a camera -> planes of its picture."""


class Eyes(nn.Module):
    """Encoders of the channels of all cameras, which give one token for each channel.

    Args:
        contract: Inputs of the policy.
        width: Features of a token.
        shared: Whether cameras share the encoder of a term. A learned vector for each channel then tells them apart.
    """

    def __init__(self, contract: PolicyContract, width: int, *, shared: bool = False) -> None:
        super().__init__()
        self.width = width
        self.names = tuple(channel.name for channel in contract.seen)
        kinds = [cameras.term_of(name) if shared else name for name in self.names]
        built = list(dict.fromkeys(kinds))
        self.eyes = nn.ModuleList(_eye(cameras.term_of(kind), width) for kind in built)
        self._numbers = tuple(map(built.index, kinds))
        several = len(built) < len(kinds)
        self.apart = nn.Parameter(torch.randn(len(kinds), width) * 0.02) if several else None

    def forward(self, inputs: Mapping[str, Tensor]) -> Tensor:
        """(..., S, W) tokens of S channels.

        Args:
            inputs: `rgb` (..., 3, H, W) in -1 to 1, `depth` (..., 2, H, W), `cloud` (..., H, W, 4), those of several
                cameras as `rgb/front`.
        """
        tokens = []
        for name, number in zip(self.names, self._numbers, strict=True):
            frames = inputs[name]
            token = self.eyes[number](frames.flatten(0, -4))
            tokens.append(token.unflatten(0, frames.shape[:-3]))
        seen = torch.stack(tokens, dim=-2)
        return seen if self.apart is None else seen + self.apart


def _eye(term: str, width: int) -> nn.Module:
    return Cloud(width) if term == "cloud" else Eye(width, PLANES[term])


class Eye(nn.Module):
    """Image encoder: convolutions, then the mean position of each feature (spatial softmax, Levine et al. 2016).

    It locates features to a fraction of a pixel from few demonstrations, which patches of a coarse map would have to
    learn; the whole image becomes one token. Where a feature is does not tell how far it is, so of depth the mean of
    each feature is given, too.
    """

    def __init__(self, width: int, planes: int = 3, points: int = 32) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.Conv2d(planes, 16, 5, stride=2, padding=2), nn.GroupNorm(4, 16), nn.ReLU()),
            *(nn.Conv2d(16, 32, 3, stride=2, padding=1), nn.GroupNorm(4, 32), nn.ReLU()),
            *(nn.Conv2d(32, 32, 3, padding=1), nn.GroupNorm(4, 32), nn.ReLU()),
            nn.Conv2d(32, points, 1),
        )
        self.far = planes == PLANES["depth"]
        read = 2 * points + (points if self.far else 0)
        self.out = nn.Sequential(nn.Linear(read, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, pixels: Tensor) -> Tensor:
        """(B, W) tokens of (B, P, H, W) pictures."""
        maps = self.layers(pixels)
        shares = maps.flatten(2).softmax(dim=-1).view_as(maps)
        rows, columns = (torch.linspace(-1.0, 1.0, size, device=maps.device) for size in maps.shape[2:])
        places = [shares.sum(dim=3) @ rows, shares.sum(dim=2) @ columns]
        if self.far:
            # The map is a quarter of the picture: its pixels are the means of what was measured in 4 x 4 pixels.
            near = nn.functional.adaptive_avg_pool2d(pixels, maps.shape[2:])
            distance = near[:, :1] / near[:, 1:].clamp(min=1e-3)
            places.append((shares * distance).sum(dim=(2, 3)))
        out: Tensor = self.out(torch.cat(places, dim=1))
        return out


class Cloud(nn.Module):
    """Point encoder: one perceptron for all points, and the maximum of each feature (Ze et al. 2024, 2403.03954)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.Linear(3, 32), nn.LayerNorm(32), nn.ReLU()),
            *(nn.Linear(32, 64), nn.LayerNorm(64), nn.ReLU()),
            nn.Linear(64, 128),
        )
        self.out = nn.Sequential(nn.Linear(128, width), nn.LayerNorm(width))

    def forward(self, cloud: Tensor) -> Tensor:
        """(B, W) tokens of (B, H, W, 4) points, the last number 1 where one was measured."""
        points = cloud.flatten(1, 2)
        known = points[..., 3:] > 0
        seen = self.layers(points[..., :3]).masked_fill(~known, -torch.inf).amax(dim=1)
        out: Tensor = self.out(torch.where(known.any(dim=1), seen, 0.0))
        return out
