"""The rasteriser as a function of torch; tensors and Warp arrays share their memory."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
import warp as wp
from torch import Tensor

from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.parameters import Trained
from dextera_build.gaussians.rasteriser.raster import Parameters, Rasteriser


def rendered(maker: Rasteriser, given: Trained, camera: FitCamera) -> tuple[Tensor, Tensor, Tensor]:
    """Colour (H, W, 3), accumulated depth (H, W) [m] and transmittance (H, W); see `raster.Picture`.

    Args:
        maker: Rasteriser for the device and the type of the tensors.
        given: Contiguous tensors.
        camera: The camera.
    """
    made: tuple[Tensor, Tensor, Tensor] = _Rendering.apply(maker, camera, *given)  # type: ignore[no-untyped-call]
    colour, depth, light = made
    return colour.view(*camera.size, 3), depth.view(camera.size), light.view(camera.size)


class _Rendering(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, maker: Rasteriser, camera: FitCamera, *given: Tensor) -> tuple[Tensor, ...]:
        with _same_stream(given[0]):
            picture = maker.forward(_parameters(maker, given), camera)
        ctx.maker, ctx.picture, ctx.given = maker, picture, given
        return tuple(wp.to_torch(each) for each in (picture.colour, picture.depth, picture.light))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        made = tuple(torch.zeros_like(each) for each in ctx.given)
        colour, depth, light = (each.contiguous() for each in gradients)
        real = ctx.maker.real
        with _same_stream(made[0]):
            worth = [wp.from_torch(colour, dtype=wp.types.vector(3, real)), wp.from_torch(depth), wp.from_torch(light)]
            ctx.maker.backward(ctx.picture, *worth, _parameters(ctx.maker, made))
        return None, None, *made


def _parameters(maker: Rasteriser, given: tuple[Tensor, ...]) -> Parameters:
    three, four = wp.types.vector(3, maker.real), wp.types.vector(4, maker.real)
    kinds = (three, four, three, maker.real, three)
    return Parameters(*(wp.from_torch(each.detach(), dtype=kind) for each, kind in zip(given, kinds, strict=True)))


def _same_stream(tensor: Tensor) -> AbstractContextManager[object]:
    """On a GPU, Warp uses the stream of torch, so that their kernels run in order."""
    if not tensor.is_cuda:
        return nullcontext()
    scoped: AbstractContextManager[object] = wp.ScopedStream(wp.stream_from_torch(tensor.device))
    return scoped
