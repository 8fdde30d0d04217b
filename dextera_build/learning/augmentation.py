"""Random changes of pictures in training, so that a policy relies neither on exact colours nor on exact places.

All numbers are drawn on the CPU from one generator, which the seed and the step of the training determine, so that an
interrupted training draws the same. Pictures are (B, 3, H, W) float32 in -1 to 1. What was measured of depth and points
is marked by 1, else all numbers are 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import torch.nn.functional as F
from torch import Tensor

from dextera_build.learning.samples import as_seen

if TYPE_CHECKING:
    from dextera_build.learning.options import ImitationOptions

GREY = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in brightness (ITU-R BT.601)."""
REACH = 3
"""Half width of a blur in its greatest standard deviations."""


def augmented(pictures: Tensor, options: ImitationOptions, random: torch.Generator) -> Tensor:
    """Changed as the options say; without any, the same tensor, and nothing is drawn."""
    if options.shift:
        pictures = shifted(pictures, options.shift, random)
    if options.crop:
        pictures = cropped(pictures, options.crop, random)
    if options.colour:
        pictures = coloured(pictures, options.colour, random)
    if options.blur_px:
        pictures = blurred(pictures, options.blur_px, random)
    if options.grain:
        noise = torch.randn(pictures.shape, generator=random).to(pictures.device)
        pictures = (pictures + 2.0 * options.grain * noise).clamp(-1.0, 1.0)
    return pictures


def swapped(
    pictures: Tensor, kept: Tensor, behind: Tensor, share: float, samples: int, random: torch.Generator
) -> Tensor:
    """Replace the background of a share of the samples by one that is drawn, half of them mirrored.

    Args:
        pictures: (B, 3, H, W), of which each sample has equally many, one after another.
        kept: Pixels (B, H, W) bool of robot and objects.
        behind: Backgrounds (K, H, W, 3) uint8 on the CPU.
        share: Fraction of the samples.
        samples: Number of samples; all pictures of one have the same background.
        random: On the CPU.
    """
    draws, number = torch.rand((samples, 2), generator=random), torch.randint(len(behind), (samples,), generator=random)
    others = as_seen("rgb", behind[number])
    others = torch.where(draws[:, 1, None, None, None] < 0.5, others.flip(-1), others).to(pictures.device)
    steps = len(pictures) // samples
    stays = (draws[:, 0] >= share).to(pictures.device).repeat_interleave(steps)
    keep = kept | stays[:, None, None]
    return torch.where(keep[:, None], pictures, others.repeat_interleave(steps, 0))


def ranged(frames: Tensor, axis: int, options: ImitationOptions, random: torch.Generator) -> Tensor:
    """Depth (B, 2, H, W) or points (B, H, W, 4) with noise and holes as the options say; nothing is drawn without any.

    Args:
        frames: Normalised numbers, with what was measured as the last entry of `axis`.
        axis: 1 of depth, 3 of points.
        options: `jitter` and `holes`.
        random: On the CPU.
    """
    count = frames.shape[axis] - 1
    numbers, known = frames.narrow(axis, 0, count), frames.narrow(axis, count, 1)
    if options.jitter:
        numbers = numbers + options.jitter * torch.randn(numbers.shape, generator=random).to(frames.device)
    if options.holes:
        most = options.holes * torch.rand((len(frames), 1, 1, 1), generator=random)
        known = known * (torch.rand(known.shape, generator=random) >= most).to(frames.device)
    return torch.cat([numbers * known, known], dim=axis)


def shifted(pictures: Tensor, most: int, random: torch.Generator) -> Tensor:
    """Shift each picture by up to `most` pixels, repeating its border."""
    height, width = pictures.shape[2:]
    wide = F.pad(pictures, (most,) * 4, mode="replicate")
    offsets = torch.randint(0, 2 * most + 1, (len(pictures), 2), generator=random).tolist()
    moved = [one[:, y : y + height, x : x + width] for one, (y, x) in zip(wide, offsets, strict=True)]
    return torch.stack(moved)


def cropped(pictures: Tensor, most: float, random: torch.Generator) -> Tensor:
    """Enlarge a random window of each picture to its size; the window lacks up to the fraction `most` of both sides."""
    draws = torch.rand((len(pictures), 3), generator=random).to(pictures.device)
    side = 1.0 - most * draws[:, 0]
    middle = (1.0 - side)[:, None] * (2.0 * draws[:, 1:] - 1.0)
    window = torch.cat([torch.diag_embed(side[:, None].expand(-1, 2)), middle[:, :, None]], dim=2)
    places = F.affine_grid(window, list(pictures.shape), align_corners=False)
    return F.grid_sample(pictures, places, mode="bilinear", padding_mode="border", align_corners=False)


def coloured(pictures: Tensor, most: float, random: torch.Generator) -> Tensor:
    """Multiply brightness, contrast, saturation and each colour by factors of 1 - `most` to 1 + `most`."""
    factors = 1.0 + most * (2.0 * torch.rand((len(pictures), 6, 1, 1, 1), generator=random) - 1.0).to(pictures.device)
    brightness, contrast, saturation = factors[:, 0], factors[:, 1], factors[:, 2]
    found = (pictures + 1.0) / 2.0 * brightness * factors[:, 3:, 0]
    grey = (found * found.new_tensor(GREY)[:, None, None]).sum(dim=1, keepdim=True)
    found = grey + (found - grey) * saturation
    mean = grey.mean(dim=(2, 3), keepdim=True)
    return (2.0 * (mean + (found - mean) * contrast) - 1.0).clamp(-1.0, 1.0)


def blurred(pictures: Tensor, most_px: float, random: torch.Generator) -> Tensor:
    """Blur each picture by a Gaussian with a standard deviation of 0 to `most_px` pixels."""
    count, reach = len(pictures), max(1, round(REACH * most_px))
    sigma = (most_px * torch.rand((count, 1), generator=random)).clamp(min=1e-3)
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / sigma) ** 2)
    weights = (weights / weights.sum(dim=1, keepdim=True)).repeat_interleave(3, 0).to(pictures.device)
    rows = F.pad(pictures, (reach,) * 4, mode="replicate").reshape(1, 3 * count, *_wider(pictures, reach))
    along = F.conv2d(rows, weights[:, None, None, :], groups=3 * count)
    return F.conv2d(along, weights[:, None, :, None], groups=3 * count).view(pictures.shape)


def _wider(pictures: Tensor, reach: int) -> tuple[int, int]:
    return pictures.shape[2] + 2 * reach, pictures.shape[3] + 2 * reach
