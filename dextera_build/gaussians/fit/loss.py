"""Loss between a rendered picture and a photograph: L1 and SSIM of colours (Kerbl et al. 2023), L1 of depth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from dextera_build.gaussians.fit.camera import FitCamera

WINDOW_PX, SIGMA_PX = 11, 1.5
"""Window of SSIM (Wang et al. 2004) [px]."""
STEADY = (0.01**2, 0.03**2)
"""Constants of SSIM for values 0..1."""


@dataclass(frozen=True)
class Target:
    """Picture and depth of a camera."""

    camera: FitCamera
    pixels: Tensor  # (H, W, 3) sRGB 0..1
    depth: Tensor | None = None  # (H, W) [m], 0 where unknown

    @cached_property
    def channels(self) -> Tensor:
        """The pixels, (3, H, W)."""
        return self.pixels.permute(2, 0, 1).contiguous()

    @cached_property
    def windowed(self) -> tuple[Tensor, Tensor]:
        """Mean and variance (3, H, W) of the pixels under the window of SSIM."""
        mean, square = blurred(torch.cat([self.channels, self.channels**2])).chunk(2)
        return mean, square - mean**2


def loss_of(made: tuple[Tensor, Tensor, Tensor], target: Target, ssim_share: float, depth_weight: float) -> Tensor:
    """(1 - s) L1 + s (1 - SSIM) of the colours + w times the mean relative error of the expected depth.

    Args:
        made: Colour (H, W, 3), accumulated depth (H, W) [m] and transmittance (H, W).
        target: Picture and depth of the camera.
        ssim_share: s.
        depth_weight: w; relative errors prevent a far wall from outweighing the table.
    """
    colour, depth, light = made
    loss = (1 - ssim_share) * (colour - target.pixels).abs().mean()
    if ssim_share:
        loss = loss + ssim_share * (1 - ssim(colour, target))
    if target.depth is None or not depth_weight:
        return loss
    known = (target.depth > 0) & (light.detach() < 0.5)
    expected = depth / (1 - light).clamp(min=0.5)
    error = (expected - target.depth).abs() / target.depth.clamp(min=1e-6)
    return loss + depth_weight * (error * known).mean()


def ssim(colour: Tensor, target: Target) -> Tensor:
    """Mean structural similarity of a picture (H, W, 3) 0..1 and the target's; black beyond the border."""
    x, y = colour.permute(2, 0, 1), target.channels
    mean, square, both = blurred(torch.cat([x, x * x, x * y])).chunk(3)
    other, other_variance = target.windowed
    first, second = STEADY
    product, squares = mean * other, mean * mean + other * other
    likeness = (2 * product + first) * (2 * (both - product) + second)
    return (likeness / ((squares + first) * (square - mean * mean + other_variance + second))).mean()


def blurred(pictures: Tensor) -> Tensor:
    """Pictures (N, H, W) under a Gaussian window; as products with matrices, several times faster than convolutions."""
    down, across = (_window(size, pictures) for size in pictures.shape[1:])
    return down @ (pictures @ across)


def _window(size: int, like: Tensor) -> Tensor:
    """The symmetric matrix (size, size) that blurs along one axis."""
    away = torch.arange(size, dtype=like.dtype, device=like.device)
    step = (away[:, None] - away).abs()
    bell = torch.exp(-(step**2) / (2 * SIGMA_PX**2)) * (step <= WINDOW_PX // 2)
    whole = sum(math.exp(-(n**2) / (2 * SIGMA_PX**2)) for n in range(-(WINDOW_PX // 2), WINDOW_PX // 2 + 1))
    return bell / whole
