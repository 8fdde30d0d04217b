"""The optimiser of 3D Gaussians: Adam with the rates of Kerbl et al. 2023; the number of Gaussians is constant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.loss import Target, loss_of
from dextera_build.gaussians.fit.parameters import Trained

Render = Callable[[Trained, FitCamera], tuple[Tensor, Tensor, Tensor]]
"""Colour (H, W, 3), accumulated depth (H, W) [m] and transmittance (H, W), with gradients."""

TURN_STEP, SCALE_STEP, OPACITY_STEP, COLOUR_STEP = 1e-3, 5e-3, 5e-2, 2.5e-3
"""Learning rates of Adam for quaternions, logarithms of scales, logits and coefficients of colours; that of the means
is a setting."""
STAY = (0.3, 0.5, 2.0, 0.5, 0.5)
"""Changes of these, in the same order, with the same penalty of the anchor as a mean displaced by a pixel; the last is
that of the view-dependent coefficients."""
LAST = 0.1
"""Final learning rates relative to the initial ones, with exponential decay."""
DIRECTED = 1 / 20
"""Learning rate of view-dependent coefficients, relative to the base colour."""


@dataclass(frozen=True)
class Settings:
    """Settings of the optimisation."""

    steps: int
    """Number of steps, one view each; all views are used before one is repeated."""
    pixel_m: float
    """Distance of neighbouring pixels on the surface [m], the unit of the means."""
    mean_step: float = 0.02
    """Initial learning rate of the means, in that unit."""
    anchor: float = 0.1
    """Weight that keeps Gaussians near their initial values, so that poorly visible ones do not drift."""
    ssim_share: float = 0.2
    """See `loss_of`."""
    depth_weight: float = 0.1
    """See `loss_of`."""
    seed: int = 0
    """Seed of the order of the views."""


def fit(
    start: Trained,
    targets: Sequence[Target],
    render: Render,
    settings: Settings,
    progress: Callable[[int, float], None] = lambda step, loss: None,
) -> Trained:
    """The Gaussians after gradient descent; `progress` is called with the number of steps and the last loss.

    Raises:
        FloatingPointError: The loss is no number.
    """
    *shapes, harmonics = start
    begun = [each.clone() for each in (*shapes, harmonics[:, :1], harmonics[:, 1:])]
    tensors = [each.clone().requires_grad_() for each in begun]
    widths = (settings.pixel_m, *STAY)
    optimiser = torch.optim.Adam(_groups(tensors, settings), eps=1e-15)
    fall = torch.optim.lr_scheduler.ExponentialLR(optimiser, LAST ** (1 / settings.steps))
    for step, number in enumerate(_turns(len(targets), settings), 1):
        target = targets[number]
        loss = loss_of(render(_joined(tensors), target.camera), target, settings.ssim_share, settings.depth_weight)
        if settings.anchor:
            pull = sum((((one - other) / s) ** 2).sum() for one, other, s in zip(tensors, begun, widths, strict=True))
            loss = loss + settings.anchor * pull / target.pixels.numel()
        if not torch.isfinite(loss):
            raise FloatingPointError(f"the loss is {loss.item()} after {step - 1} steps")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        fall.step()
        progress(step, loss.item())
    return Trained(*(each.detach() for each in _joined(tensors)))


def _groups(tensors: list[Tensor], settings: Settings) -> list[dict[str, Any]]:
    rates = (
        settings.mean_step * settings.pixel_m,
        TURN_STEP,
        SCALE_STEP,
        OPACITY_STEP,
        COLOUR_STEP,
        COLOUR_STEP * DIRECTED,
    )
    pairs = zip(tensors, rates, strict=True)
    return [{"params": [tensor], "lr": rate} for tensor, rate in pairs if tensor.numel()]


def _joined(tensors: list[Tensor]) -> Trained:
    means, quaternions, log_scales, logits, base, rest = tensors
    return Trained(means, quaternions, log_scales, logits, torch.cat([base, rest], dim=1))


def _turns(count: int, settings: Settings) -> Iterator[int]:
    """The view of each step."""
    draw, order = np.random.default_rng(settings.seed), list[int]()
    for _ in range(settings.steps):
        order = order or draw.permutation(count).tolist()
        yield order.pop()
