"""A stand-in for gsplat with the signature of its `rasterization` in 1.5.3, on the dense renderer of the tests."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tests.gaussians import dense_splats


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,  # noqa: N803
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """One camera; pixels have their centre at a half, depth is the last channel."""
    assert viewmats.shape == (1, 4, 4)
    assert Ks.shape == (1, 3, 3)
    assert means.shape == scales.shape == (len(opacities), 3)
    assert sh_degree is not None
    assert colors.shape == (len(means), (sh_degree + 1) ** 2, 3)
    assert render_mode == "RGB+D"
    k = Ks[0].double().numpy().copy()
    k[:2, 2] -= 0.5
    given = (means, quats, scales.log(), torch.logit(opacities), colors)
    pose = torch.linalg.inv(viewmats[0].double()).numpy()
    made = dense_splats.render(*(each.double() for each in given), k=k, pose=pose, size=(height, width))
    colour, depth, light = (each.to(means.dtype) for each in made)
    shown = torch.cat([colour, depth[:, None]], dim=1).view(1, height, width, 4)
    return shown, (1 - light).view(1, height, width, 1), {}
