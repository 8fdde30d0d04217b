"""background.compose by optimisation with the rasteriser of `learning.rasteriser`, on the CPU or a GPU."""

from __future__ import annotations

from functools import partial

from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.learning import reproducible
from dextera_build.rule import Backend, Context

from .optimise import optimised
from .optimise_options import OptimiseOptions

BACKEND = Backend(
    summary="Gaussians on the points, optimised on the views by a rasteriser in NVIDIA Warp",
    packages=("numpy", "torch", "warp-lang"),
    extra="warp",
    uses=("points",),
    gpu_gb=8.0,
    cpu=True,
)


def compose(ctx: Context, views: Views, background: Background | None, options: OptimiseOptions) -> Room:
    """Fitted Gaussians; on the CPU the result does not depend on the number of cores, on a GPU sums have no order."""
    # Imported here, so that options can be read where Warp is not installed.
    from dextera_build.gaussians.rasteriser.autograd import rendered
    from dextera_build.gaussians.rasteriser.raster import Rasteriser

    maker = Rasteriser(ctx.device)
    if ctx.device != "cpu":
        return optimised(ctx, views, background, options, partial(rendered, maker))
    with reproducible.one_thread():
        return optimised(ctx, views, background, options, partial(rendered, maker))
