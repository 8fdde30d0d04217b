"""One forward and one backward pass of the rasteriser, timed: `python -m tests.benchmarks.rasteriser`.

It prints seconds of this process as JSON: the import, the first passes, which compile kernels or read them from the
cache, and the quickest and the processor time of further ones.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np

from dextera_build.gaussians import splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.fit.camera import FitCamera

SIZE = (480, 640)
K = np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1.0]])


def scene(count: int, degree: int = 0, width_m: float = 0.012) -> Gaussians:
    """Gaussians of many sizes, 1 to 4 m ahead, that cover the whole picture."""
    draw = np.random.default_rng(0)
    z = draw.uniform(1, 4, count)
    means = np.stack([draw.uniform(-0.65, 0.65, count) * z, draw.uniform(-0.5, 0.5, count) * z, z], axis=1)
    turns = draw.normal(size=(count, 4))
    return Gaussians(
        means,
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        width_m * draw.uniform(0.5, 1.5, (count, 3)),
        1 / (1 + np.exp(-1.5 * draw.normal(size=count))),
        0.3 * draw.normal(size=(count, (degree + 1) ** 2, 3)),
    )


class Passes:
    """The rasteriser with a scene and gradients of its picture."""

    def __init__(self, given: Gaussians, threads: int) -> None:
        import warp as wp

        from dextera_build.gaussians.rasteriser.raster import Parameters, Rasteriser

        self.maker = Rasteriser(threads=threads)
        logits = np.log(given.opacities) - np.log1p(-given.opacities)
        arrays = (given.means, given.rotations, np.log(given.scales), logits, given.harmonics)
        kinds = (wp.vec3, wp.vec4, wp.vec3, wp.float32, wp.vec3)
        self.given, self.into = (
            Parameters(*(wp.array(each, dtype=kind, device="cpu") for each, kind in zip(arrays, kinds, strict=True)))
            for _ in range(2)
        )
        pixels = SIZE[0] * SIZE[1]
        self.worth = [wp.full(pixels, 1.0, dtype=kind, device="cpu") for kind in (wp.vec3, wp.float32, wp.float32)]

    def forward(self) -> Any:
        """The picture."""
        return self.maker.forward(self.given, FitCamera(K, np.eye(4), SIZE))

    def backward(self, picture: Any) -> None:
        """The gradients of all parameters."""
        self.maker.backward(picture, *self.worth, self.into)


def timed(given: Gaussians, threads: int, rounds: int) -> dict[str, float]:
    """Seconds of the quickest of some rounds, on the clock and of the processor, after one that is not counted."""
    began = time.perf_counter()
    passes = Passes(given, threads)
    passes.backward(passes.forward())
    found = {"first": time.perf_counter() - began}
    rows = []
    for _ in range(rounds):
        marks = [(time.perf_counter(), time.process_time())]
        picture = passes.forward()
        marks.append((time.perf_counter(), time.process_time()))
        passes.backward(picture)
        marks.append((time.perf_counter(), time.process_time()))
        rows.append(np.diff(np.array(marks), axis=0).ravel())
    names = ("forward", "forward_cpu", "backward", "backward_cpu")
    return found | dict(zip(names, np.min(rows, axis=0).tolist(), strict=True)) | {"pairs": len(picture.kept.run)}


def preview_seconds(given: Gaussians) -> float:
    """Processor time of the same picture by `geometry.splatting`, in NumPy [s]."""
    began = time.process_time()
    splatting.render(given, K, np.eye(4), SIZE)
    return time.process_time() - began


def main() -> None:
    """Print the times of a process."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--gaussians", type=int, default=50_000)
    parser.add_argument("--degree", type=int, default=0)
    parser.add_argument("--width-m", type=float, default=0.012)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    began = time.perf_counter()
    import warp  # noqa: F401

    found = {"import": time.perf_counter() - began}
    made = scene(given.gaussians, given.degree, given.width_m)
    print(json.dumps(found | timed(made, given.threads, given.rounds)))


if __name__ == "__main__":
    main()
