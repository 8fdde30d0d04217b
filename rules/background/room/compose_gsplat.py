"""background.compose by optimisation with gsplat (Ye et al. 2024), on a GPU with CUDA."""

from __future__ import annotations

import torch
from torch import Tensor

from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.parameters import Trained
from dextera_build.rule import Backend, Context

from .optimise import optimised
from .optimise_options import OptimiseOptions

BACKEND = Backend(
    summary="Gaussians on the points, optimised on the views by gsplat",
    packages=("gsplat", "numpy", "torch"),
    extra="gsplat",
    uses=("points",),
    gpu_gb=8.0,
)

DEGREES = {1: 0, 4: 1, 9: 2, 16: 3}
"""Number of coefficients -> degree."""


def compose(ctx: Context, views: Views, background: Background | None, options: OptimiseOptions) -> Room:
    """Fitted Gaussians; the order of sums is undefined, so that results differ in their last bits."""
    return optimised(ctx, views, background, options, rendered)


def rendered(given: Trained, camera: FitCamera) -> tuple[Tensor, Tensor, Tensor]:
    """Colour (H, W, 3), accumulated depth (H, W) [m] and transmittance (H, W)."""
    from gsplat import rasterization

    rows, columns = camera.size
    k = torch.tensor(camera.k).to(given.means)
    k[:2, 2] += 0.5  # its pixel centres are at a half
    view = torch.linalg.inv(torch.tensor(camera.world_from_camera)).to(given.means)
    made, opacity, _ = rasterization(
        means=given.means,
        quats=given.quaternions,
        scales=given.log_scales.exp(),
        opacities=given.logits.sigmoid(),
        colors=given.harmonics,
        viewmats=view[None],
        Ks=k[None],
        width=columns,
        height=rows,
        near_plane=camera.near_m,
        sh_degree=DEGREES[given.harmonics.shape[1]],
        packed=False,
        render_mode="RGB+D",
    )
    return made[0, ..., :3], made[0, ..., 3], 1 - opacity[0, ..., 0]
