"""Gaussians as tensors for an optimiser."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dextera_build.gaussians.arrays import Gaussians

LEAST = 1e-4
"""Minimum distance of opacities from 0 and 1, where the gradient of their logit vanishes."""


class Trained(NamedTuple):
    """N Gaussians in one frame, in an unconstrained parametrisation."""

    means: Tensor  # (N, 3) [m]
    quaternions: Tensor  # (N, 4) w x y z, of any length
    log_scales: Tensor  # (N, 3) logarithms of standard deviations [m]
    logits: Tensor  # (N,) of opacities
    harmonics: Tensor  # (N, K, 3), see `geometry.spherical_harmonics`


def opened(given: Gaussians, device: str, degree: int) -> Trained:
    """Gaussians as float32 tensors on a device, with coefficients of a given degree; missing ones are 0."""
    opacities = given.opacities.clip(LEAST, 1 - LEAST)
    harmonics = np.zeros((len(given), (degree + 1) ** 2, 3))
    known = min(harmonics.shape[1], given.harmonics.shape[1])
    harmonics[:, :known] = given.harmonics[:, :known]
    logits = np.log(opacities) - np.log1p(-opacities)
    arrays = (given.means, given.rotations, np.log(given.scales), logits, harmonics)
    return Trained(*(torch.tensor(array, dtype=torch.float32, device=device) for array in arrays))


def closed(given: Trained) -> Gaussians:
    """Convert back to values, float64; quaternions have unit length."""
    means, quaternions, log_scales, logits, harmonics = (each.detach().cpu().numpy().astype(float) for each in given)
    turns = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    return Gaussians(means, turns, np.exp(log_scales), 1 / (1 + np.exp(-logits)), harmonics)
