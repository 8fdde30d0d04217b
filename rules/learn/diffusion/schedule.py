"""Levels of noise, and the way back from noise to a sample.

Level k of K mixes a sample x with noise e: x_k = sqrt(a_k) x + sqrt(1 - a_k) e, both with variance near 1, where the
share a_k of the sample falls from nearly 1 to nearly 0 along a squared cosine (Nichol and Dhariwal 2021,
arXiv 2102.09672). The way back is that of denoising diffusion implicit models with eta 0, which adds no noise and may
leave out levels (Song et al. 2021, arXiv 2010.02502).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

OFFSET = 0.008
"""Keeps the noise of the first level from vanishing."""
MOST_LOST = 0.999
"""Greatest share of the sample that one level loses."""


def shares(levels: int) -> Tensor:
    """The shares a_k (K,) float32 of the sample's variance at each level of noise."""
    phase = (np.arange(levels + 1) / levels + OFFSET) / (1 + OFFSET)
    left = np.cos(phase * np.pi / 2) ** 2
    kept = np.maximum(left[1:] / left[:-1], 1 - MOST_LOST)
    return torch.from_numpy(np.cumprod(kept).astype(np.float32))


def noised(samples: Tensor, noise: Tensor, share: Tensor) -> Tensor:
    """Samples (B, ...) mixed with noise of the same shape; `share` (B,) is a_k of each."""
    kept = share.view(-1, *[1] * (samples.ndim - 1))
    return kept.sqrt() * samples + (1 - kept).sqrt() * noise


def visited(levels: int, passes: int) -> list[int]:
    """The levels of noise of `passes` denoisings, falling to 0, evenly spaced."""
    return [number * (levels // passes) for number in reversed(range(passes))]


def waves(levels: Tensor, size: int) -> Tensor:
    """Levels of noise (B,) as sines and cosines (B, size) of frequencies from 1 to 1e-4 (Vaswani et al. 2017)."""
    rates = torch.logspace(0.0, -4.0, size // 2, device=levels.device)
    phases = levels[:, None] * rates
    return torch.cat([phases.sin(), phases.cos()], dim=1)


def denoised(
    noise: Tensor, share: Tensor, passes: int, told: Callable[[Tensor, int], Tensor], what: str = "noise"
) -> Tensor:
    """Samples in -1 to 1 from noise of the same shape.

    Args:
        noise: Standard normal numbers (B, ...).
        share: a_k (K,).
        passes: Number of calls of `told`.
        told: The noise in mixed samples at a level, or the samples without it, as far as the network can tell.
        what: `noise` or `sample`: which of the two `told` returns.
    """
    samples, levels = noise, visited(len(share), passes)
    for level, after in zip(levels, [*levels[1:], None], strict=True):
        found = told(samples, level)
        if what == "sample":
            clean, found = found, (samples - share[level].sqrt() * found) / (1 - share[level]).sqrt()
        else:
            clean = (samples - (1 - share[level]).sqrt() * found) / share[level].sqrt()
        # An error of the noise is large in the sample where its share is small: all samples are known to be in range.
        clean = clean.clamp(-1.0, 1.0)
        samples = clean if after is None else share[after].sqrt() * clean + (1 - share[after]).sqrt() * found
    return samples
