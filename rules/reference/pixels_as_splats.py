"""reference.pixels_as_splats: measured pixels as Gaussians of unknown scale, in place of a scene generator."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.scenes.draw import Viewpoint
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import flat
from dextera_build.geometry import cameras
from dextera_build.rule import Context, Options, rule


class PixelsAsSplatsOptions(Options):
    """Options of reference.pixels_as_splats."""

    scale_factor: PositiveFloat = 1.0
    """Scene units per metre, which a generated scene does not state."""
    spread: float = Field(0.45, gt=0.0, le=5.0)
    """Standard deviation of a Gaussian, in distances between neighbouring pixels."""
    edge_fraction: float = Field(0.04, gt=0.0, le=1.0)
    """Relative depth difference of neighbours above which pixels are left out."""


@rule(version=2, packages=("numpy", "scipy"))
def pixels_as_splats(
    ctx: Context, capture: Capture, viewpoint: Viewpoint | None = None, *, options: PixelsAsSplatsOptions | None = None
) -> Splats:
    """Return a Gaussian for each measured pixel, in frame `scene`: the camera's axes, lengths in an unknown unit.

    Args:
        ctx: Context.
        capture: Colours and depth.
        viewpoint: Random unit of lengths (`Viewpoint.unit`), multiplied by `scale_factor`.
        options: Options.
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    options = options or PixelsAsSplatsOptions()
    if capture.measured is None:
        ctx.fail("the capture has no depth", hint="align.scene takes scenes from elsewhere, too")
    factor = options.scale_factor * (viewpoint.unit if viewpoint else 1.0)
    depth, k = capture.measured.depth.depth.astype(np.float64), capture.photograph.camera.matrix()
    apart = maximum_filter(depth, 3) - minimum_filter(np.where(depth > 0, depth, np.inf), 3)
    kept = (depth > 0) & (apart < options.edge_fraction * depth)
    ctx.check(bool(kept.any()), "no pixel has a neighbour with depth on the same surface")
    across = options.spread * factor * depth[kept] / k[0, 0]
    means = factor * cameras.backproject(depth, k)[kept]
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(means), 1))
    colours = flat(capture.photograph.rgb.pixels[kept] / 255.0)
    made = Gaussians(means, turns, np.repeat(across[:, None], 3, axis=1), np.full(len(means), 0.97), colours)
    found = Splats.of(made, "scene")
    ctx.say(", ".join(found.facts()))
    return found
