"""Sorting of Gaussians by tile and depth."""

# No `from __future__ import annotations`: Warp reads the annotations of kernels, which are types of this call.
from functools import cache
from typing import Any

import warp as wp

from dextera_build.gaussians.rasteriser.projection import TILE_PX


@cache
def listing(real: Any) -> Any:
    """The kernel that writes one pair for each tile that a Gaussian touches: key, tile before depth, and index."""
    eight = wp.types.vector(8, real)

    @wp.kernel(module="unique", enable_backward=False)
    def pairs(
        size: wp.vec2i,
        flat: wp.array[eight],
        boxes: wp.array[wp.vec4i],
        counts: wp.array[wp.int32],
        ends: wp.array[wp.int32],
        keys: wp.array[wp.int64],
        numbers: wp.array[wp.int32],
        owners: wp.array[wp.int32],
    ) -> None:
        i = wp.tid()
        if counts[i] == 0:
            return
        box = boxes[i]
        wide = (size[0] + TILE_PX - 1) / TILE_PX
        k = ends[i] - counts[i]
        # The bit patterns of positive floats are ordered like the numbers.
        nearness = wp.int64(wp.cast(wp.float32(flat[i][7]), wp.int32))
        for row in range(box[1], box[3] + 1):
            for column in range(box[0], box[2] + 1):
                keys[k] = (wp.int64(row * wide + column) << wp.int64(32)) | nearness
                numbers[k] = k
                owners[k] = i
                k += 1

    return pairs


@cache
def gathering(real: Any) -> Any:
    """The kernel that copies the data of each tile into one run, and records the start of each tile."""
    three, eight = (wp.types.vector(length, real) for length in (3, 8))

    @wp.kernel(module="unique", enable_backward=False)
    def gather(
        keys: wp.array[wp.int64],
        numbers: wp.array[wp.int32],
        owners: wp.array[wp.int32],
        flat: wp.array[eight],
        colours: wp.array[three],
        places: wp.array[wp.int32],
        starts: wp.array[wp.int32],
        run: wp.array[eight],
        tones: wp.array[three],
    ) -> None:
        place = wp.tid()
        k = numbers[place]
        places[k] = place
        run[place] = flat[owners[k]]
        tones[place] = colours[owners[k]]
        tile = int(keys[place] >> wp.int64(32))
        before = int(-1)
        if place > 0:
            before = int(keys[place - 1] >> wp.int64(32))
        # `starts` of all further tiles already contain the number of pairs.
        for passed in range(before + 1, tile + 1):
            starts[passed] = place

    return gather
