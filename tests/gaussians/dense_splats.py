"""3D Gaussians rendered without tiles in torch: every Gaussian in every pixel; gradients are those of autograd."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dextera_build.gaussians import spherical_harmonics

LOW_PASS, LEAST, MOST, LEAST_LIGHT = 0.3, 1 / 255, 0.99, 1e-4


def render(
    means: Tensor,
    quaternions: Tensor,
    log_scales: Tensor,
    logits: Tensor,
    harmonics: Tensor,
    *,
    k: np.ndarray,
    pose: np.ndarray,
    size: tuple[int, int],
) -> tuple[Tensor, Tensor, Tensor]:
    """Colour (H W, 3), summed depth (H W,) and passing light (H W,), float64."""
    turn, eye = torch.tensor(pose[:3, :3]), torch.tensor(pose[:3, 3])
    places = (means - eye) @ turn
    opacity = torch.sigmoid(logits)
    seen = torch.nonzero((places[:, 2] > 0.01) & (opacity >= LEAST))[:, 0]
    seen = seen[torch.argsort(places[seen, 2].float(), stable=True)]
    p, opacity = places[seen], opacity[seen]
    conics = torch.linalg.inv(_spread(p, quaternions[seen], log_scales[seen], turn, k, size))
    centres = torch.stack([k[0, 0] * p[:, 0] / p[:, 2] + k[0, 2], k[1, 1] * p[:, 1] / p[:, 2] + k[1, 2]], dim=1)
    rows, columns = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) for n in size), indexing="ij")
    away = torch.stack([columns.ravel(), rows.ravel()], dim=1) - centres[:, None]
    exponent = 0.5 * torch.einsum("npi,nij,npj->np", away, conics, away)
    bare = opacity[:, None] * torch.exp(-exponent)
    alpha = torch.where(bare >= LEAST, bare.clamp(max=MOST), 0.0)
    kept = torch.cumprod(1 - alpha, dim=0) > LEAST_LIGHT
    alpha = torch.where(kept, alpha, 0.0)
    passed = torch.cumprod(1 - alpha, dim=0)
    weight = alpha * torch.cat([torch.ones_like(passed[:1]), passed[:-1]])
    colours = _colours(means[seen] - eye, harmonics[seen])
    return weight.T @ colours, weight.T @ p[:, 2], passed[-1]


def _spread(
    p: Tensor, quaternions: Tensor, log_scales: Tensor, turn: Tensor, k: np.ndarray, size: tuple[int, int]
) -> Tensor:
    w, v = torch.split(quaternions / quaternions.norm(dim=1, keepdim=True), [1, 3], dim=1)
    zero = torch.zeros_like(w[:, 0])
    cross = torch.stack([zero, -v[:, 2], v[:, 1], v[:, 2], zero, -v[:, 0], -v[:, 1], v[:, 0], zero], dim=1)
    cross = cross.view(-1, 3, 3)
    half = (torch.eye(3, dtype=p.dtype) + 2 * w[:, :, None] * cross + 2 * cross @ cross) * log_scales.exp()[:, None]
    limits = torch.tensor([1.3 * size[1] / 2 / k[0, 0], 1.3 * size[0] / 2 / k[1, 1]])
    slope = torch.maximum(torch.minimum(p[:, :2] / p[:, 2:], limits), -limits)
    focal = torch.tensor([k[0, 0], k[1, 1]])
    jacobian = torch.cat([torch.diag(focal).expand(len(p), 2, 2), (-focal * slope)[:, :, None]], dim=2)
    across = jacobian / p[:, 2:, None] @ turn.T @ half
    return across @ across.transpose(1, 2) + LOW_PASS * torch.eye(2, dtype=p.dtype)


def _colours(ray: Tensor, harmonics: Tensor) -> Tensor:
    """From the polynomials that agree with `geometry.spherical_harmonics` on the sphere."""
    way = ray / ray.norm(dim=1, keepdim=True)
    random = np.random.default_rng(0).normal(size=(400, 3))
    probes = random / np.linalg.norm(random, axis=1, keepdims=True)
    wanted = spherical_harmonics.basis(probes, harmonics.shape[1])
    known = np.linalg.lstsq(_monomials(torch.tensor(probes)).numpy(), wanted, rcond=None)[0]
    values = _monomials(way) @ torch.tensor(known)
    return (0.5 + torch.einsum("nk,nkc->nc", values, harmonics)).clamp(min=0)


def _monomials(way: Tensor) -> Tensor:
    x, y, z = way.T
    powers = [(i, j, n) for i in range(4) for j in range(4 - i) for n in range(4 - i - j)]
    return torch.stack([x**i * y**j * z**n for i, j, n in powers], dim=1)
