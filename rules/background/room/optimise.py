"""Optimisation of Gaussians on views, initialised from points, for any renderer."""

from __future__ import annotations

import numpy as np
import torch

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.fit import Render, Settings, fit
from dextera_build.gaussians.fit.loss import Target
from dextera_build.gaussians.fit.parameters import Trained, closed, opened
from dextera_build.geometry import metrics
from dextera_build.rule import Context

from .optimise_options import OptimiseOptions
from .seen_depth import seen_depth
from .thinned import thinned

LINES = 20
"""Number of log lines about the loss."""


def optimised(
    ctx: Context, views: Views, background: Background | None, options: OptimiseOptions, render: Render
) -> Room:
    """The Gaussians of backend `points`, fitted to all views but the held-out ones, on the device of the call."""
    if not all(isinstance(views.lens(name), Camera) for name in views.names):
        ctx.fail("the optimiser takes pictures of pinhole cameras", hint="undistort them, or use backend `points`")
    start = _start(ctx, views, background, options)
    known = start.points if views.points is None else views.points
    targets = {name: _target(views, name, known, ctx.device) for name in views.names}
    apart = _held_out(views, options)
    given = opened(start.splats.gaussians, ctx.device, options.degree)
    before = _likeness(given, [targets[name] for name in apart], render)
    try:
        made = fit(
            given,
            [target for name, target in targets.items() if name not in apart],
            render,
            _settings(options, start.points),
            lambda step, loss: _tell(ctx, step, options.steps, loss),
        )
    except FloatingPointError as error:
        ctx.fail(f"the optimiser diverged: {error}", hint="lower `mean_step`, or use backend `points`")
    if before is not None:
        ctx.metric("held-out views before", before, "dB")
        ctx.metric("held-out views", _likeness(made, [targets[name] for name in apart], render) or 0.0, "dB")
    return Room(splats=Splats.of(closed(made), views.frame), points=start.points)


def _start(ctx: Context, views: Views, background: Background | None, options: OptimiseOptions) -> Room:
    """Backend `points` on at most `most` points."""
    points = views.points
    if points is not None and len(points.points) > options.most:
        ctx.log(f"{len(points.points):,} points, of which neighbours are joined")
        views = views.model_copy(update={"points": thinned(points, options.most)})
    start: Room = ctx.other("points").compose(views, background)
    return start


def _settings(options: OptimiseOptions, points: PointCloud) -> Settings:
    return Settings(
        options.steps,
        pixel_m=float(np.median(_footprints(points))),
        mean_step=options.mean_step,
        anchor=options.anchor,
        ssim_share=options.ssim_share,
        depth_weight=options.depth_weight,
        seed=options.seed,
    )


def _footprints(points: PointCloud) -> np.ndarray:
    """Distance (N,) [m] of each point from its neighbours, or a thousandth of the extent if it is not stated."""
    if "footprint" in points.attributes:
        return points.attributes["footprint"]
    return np.full(1, 1e-3 * float(np.linalg.norm(np.ptp(points.points, axis=0))))


def _target(views: Views, name: str, points: PointCloud, device: str) -> Target:
    lens, pose = views.lens(name), views.pose(name).matrix
    size = (lens.height, lens.width)
    eye = FitCamera(lens.matrix(), pose, size)  # type: ignore[union-attr]
    pixels = torch.tensor(views.pixels(name), dtype=torch.float32, device=device) / 255
    depth = torch.tensor(seen_depth(points.points, eye), dtype=torch.float32, device=device)
    return Target(eye, pixels, depth)


def _held_out(views: Views, options: OptimiseOptions) -> set[str]:
    """Views held out; never all, and never the first, which is nearest to the photograph."""
    if not options.held_out or len(views.names) < 3:
        return set()
    return set(views.names[max(1, options.held_out // 2) :: options.held_out])


def _likeness(given: Trained, targets: list[Target], render: Render) -> float | None:
    """Mean PSNR [dB]; None without a view."""
    found = []
    for target in targets:
        with torch.no_grad():
            colour = render(given, target.camera)[0]
        pair = [np.round(255 * each.clamp(0, 1).cpu().numpy()).astype(np.uint8) for each in (colour, target.pixels)]
        found.append(metrics.psnr(pair[0], pair[1], np.ones(target.camera.size, bool)) or 99.0)
    return float(np.mean(found)) if found else None


def _tell(ctx: Context, step: int, steps: int, loss: float) -> None:
    ctx.progress(step, steps, f"steps, loss {loss:.4f}")
    if step % max(1, steps // LINES) == 0:
        ctx.log(f"step {step:,} of {steps:,}, loss {loss:.4f}")
