"""The rasteriser: from Gaussians and a camera to a picture, and its gradients."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.rasteriser import blending, gradients, projection, tiles

WIDEST = 1.3
"""Limit of the directions of linearisation, as a multiple of half the field of view."""


@dataclass(frozen=True)
class Parameters:
    """Warp arrays on one device, or objects with the same memory: N Gaussians in the optimiser's parametrisation."""

    means: Any  # (N, 3) [m]
    quaternions: Any  # (N, 4) w x y z, of any length
    log_scales: Any  # (N, 3) logarithms of standard deviations [m]
    logits: Any  # (N,) of opacities
    harmonics: Any  # (N, K, 3), see `geometry.spherical_harmonics`


@dataclass(frozen=True)
class Picture:
    """Rendering by a camera; Warp arrays, one entry per pixel, row by row."""

    colour: Any  # (H W, 3) sRGB over black
    depth: Any  # (H W,) sum of weight times depth [m]; divided by `1 - light` it is the expected depth
    light: Any  # (H W,) transmittance of all Gaussians, 0..1; 1 minus it is their opacity
    kept: Any  # data for the gradients; None if there are none


@dataclass(frozen=True)
class _Kept:
    parameters: Parameters
    camera: tuple[Any, ...]
    flat: Any
    colours: Any
    counts: Any
    ends: Any
    places: Any
    starts: Any
    run: Any
    tones: Any
    lasts: Any


class Rasteriser:
    """Kernels for one device and one floating-point type.

    On the CPU Warp runs a kernel in one thread, so tiles are distributed over threads of this process. They write to
    disjoint memory, and the order of sums is fixed, so that CPU results do not depend on the number of threads.

    Args:
        device: `cpu` or `cuda`, as in Warp.
        double: Whether to compute in float64.
        threads: Threads on the CPU; None for the cores of the process.
    """

    def __init__(self, device: str = "cpu", *, double: bool = False, threads: int | None = None) -> None:
        _prepare()
        self.device = device
        self.real = wp.float64 if double else wp.float32
        self.threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self.threads) if device == "cpu" and self.threads > 1 else None

    def forward(self, parameters: Parameters, camera: FitCamera, limits: Any = None, *, faded: bool = False) -> Picture:
        """Render the Gaussians.

        The low-pass enlarges Gaussians smaller than a pixel to its size, so that together they cover too much and the
        nearest hides the others. With `faded` their opacity is reduced accordingly (the 2D filter of Mip-Splatting, Yu
        et al. 2024), so that a small picture shows the mean of a large one.

        Args:
            parameters: The Gaussians.
            camera: The camera.
            limits: (H W,) depth of an opaque surface in each pixel [m], which hides farther means; or None.
            faded: Whether opacities compensate the low-pass; such a picture has no gradients.
        """
        rows, columns = camera.size
        placed, size = self._camera(camera), wp.vec2i(columns, rows)
        given = parameters
        count = len(given.means)
        flat, colours = self._new(count, 8), self._new(count, 3)
        boxes, counts = (wp.empty(count, dtype=kind, device=self.device) for kind in (wp.vec4i, wp.int32))
        arrays = [given.means, given.quaternions, given.log_scales, given.logits, given.harmonics]
        out = [flat, colours, boxes, counts]
        self._launch(projection.projecting(self.real), count, [*arrays, *placed, size, int(faded), *out])
        ends = wp.empty(count, dtype=wp.int32, device=self.device)
        wp.utils.array_scan(counts, ends, inclusive=True)
        pairs = int(ends[-1:].numpy()[0]) if count else 0
        starts, places, run, tones = self._sorted(size, flat, colours, boxes, counts, ends, pairs)
        picture, depth, light = self._new(rows * columns, 3), self._new(rows * columns), self._new(rows * columns)
        lasts = wp.empty(rows * columns, dtype=wp.int32, device=self.device)
        if limits is None:
            limits = wp.full(rows * columns, float("inf"), dtype=self.real, device=self.device)
        self._by_tiles(
            blending.blending(self.real), starts, [size, starts, run, tones, limits, picture, depth, light, lasts]
        )
        kept = _Kept(given, (*placed, size), flat, colours, counts, ends, places, starts, run, tones, lasts)
        return Picture(picture, depth, light, None if faded else kept)

    def backward(self, picture: Picture, to_colour: Any, to_depth: Any, to_light: Any, into: Parameters) -> None:
        """Add the gradients of the parameters to `into`, initially zeros, given those of a picture's arrays."""
        kept, given = picture.kept, picture.kept.parameters
        *placed, size = kept.camera
        pairs = len(kept.run)
        to_run, to_tones = self._zeros(pairs, 8), self._zeros(pairs, 3)
        pixels = [size, kept.starts, kept.run, kept.tones, picture.light, kept.lasts, to_colour, to_depth, to_light]
        self._by_tiles(blending.unblending(self.real), kept.starts, [*pixels, to_run, to_tones])
        count = len(given.means)
        to_flat, to_colours = self._new(count, 8), self._new(count, 3)
        pairs_of = [kept.counts, kept.ends, kept.places]
        self._launch(gradients.adding(self.real), count, [*pairs_of, to_run, to_tones, to_flat, to_colours])
        turn, eye, lens = placed
        given_colours = [given.means, given.harmonics, eye, kept.colours, kept.counts]
        out = [into.means, into.harmonics]
        self._launch(gradients.recolouring(self.real), count, [*given_colours, to_colours, *out])
        given_shapes = [given.means, given.quaternions, given.log_scales, turn, eye, lens, kept.flat, kept.counts]
        out = [into.means, into.quaternions, into.log_scales, into.logits]
        self._launch(gradients.reshaping(self.real), count, [*given_shapes, to_flat, *out])

    def _sorted(self, size: Any, flat: Any, colours: Any, boxes: Any, counts: Any, ends: Any, pairs: int) -> Any:
        """Start of each tile, position of each pair, and sorted data of the tiles, from near to far."""
        many = _across(size[0]) * _across(size[1])
        keys = wp.empty(2 * pairs, dtype=wp.int64, device=self.device)
        numbers = wp.empty(2 * pairs, dtype=wp.int32, device=self.device)
        owners, places = (wp.empty(pairs, dtype=wp.int32, device=self.device) for _ in range(2))
        self._launch(tiles.listing(self.real), len(counts), [size, flat, boxes, counts, ends, keys, numbers, owners])
        wp.utils.radix_sort_pairs(keys, numbers, pairs, 0, 32 + many.bit_length())
        starts = wp.full(many + 1, pairs, dtype=wp.int32, device=self.device)
        run, tones = self._new(pairs, 8), self._new(pairs, 3)
        self._launch(
            tiles.gathering(self.real), pairs, [keys, numbers, owners, flat, colours, places, starts, run, tones]
        )
        return starts, places, run, tones

    def _camera(self, camera: FitCamera) -> tuple[Any, Any, Any]:
        """Rotation, position and intrinsics for kernels."""
        pose, k, (rows, columns) = camera.world_from_camera, camera.k, camera.size
        limits = WIDEST * columns / 2 / k[0, 0], WIDEST * rows / 2 / k[1, 1]
        turn = wp.types.matrix((3, 3), self.real)(*pose[:3, :3].T.ravel().tolist())
        eye = wp.types.vector(3, self.real)(*pose[:3, 3].tolist())
        lens = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], *limits, camera.near_m)
        return turn, eye, wp.types.vector(7, self.real)(*map(float, lens))

    def _new(self, count: int, width: int = 1) -> Any:
        kind = self.real if width == 1 else wp.types.vector(width, self.real)
        return wp.empty(count, dtype=kind, device=self.device)

    def _zeros(self, count: int, width: int) -> Any:
        return wp.zeros(count, dtype=wp.types.vector(width, self.real), device=self.device)

    def _launch(self, kernel: Any, count: int, arguments: Sequence[Any]) -> None:
        if count:
            wp.launch(kernel, dim=count, inputs=arguments, device=self.device)

    def _by_tiles(self, kernel: Any, starts: Any, arguments: Sequence[Any]) -> None:
        """Run a kernel for every pixel of every tile, on the CPU in threads."""
        many, pixels = len(starts) - 1, projection.TILE_PX**2
        if self._pool is None:
            self._launch(kernel, many * pixels, [0, *arguments])
            return
        wp.load_module(kernel.module, device=self.device)
        bounds = np.unique(np.linspace(0, many, 8 * self.threads + 1).astype(int))
        jobs = [
            self._pool.submit(self._launch, kernel, (stop - start) * pixels, [start, *arguments])
            for start, stop in pairwise(bounds.tolist())
        ]
        for job in jobs:
            job.result()


@cache
def _prepare() -> None:
    """Compiled kernels are cached in `dxb/warp` of the user's cache folder, or in `WARP_CACHE_PATH`."""
    wp.config.log_level = wp.LOG_WARNING
    if "WARP_CACHE_PATH" not in os.environ:
        folder = os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
        wp.config.kernel_cache_dir = os.path.join(folder, "dxb", "warp")
    wp.init()


def _across(pixels: int) -> int:
    return -(-pixels // projection.TILE_PX)
