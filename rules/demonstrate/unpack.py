"""demonstrate.unpack: decode a film once, for learners that read its pictures in random order many times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dextera_build.artifacts.tasks.episode import Film
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy",))
def unpack(ctx: Context, film: Film) -> Pixels:
    """Return the pictures (T, H, W, 3) uint8 of every episode, and its depth if the film has it, decoded.

    The store memory-maps them.
    """
    size, found, depth = (film.height, film.width), dict[str, np.ndarray](), dict[str, np.ndarray]()
    for number, index in enumerate(film.frames):
        found[index] = _mapped(ctx.scratch / f"{number}.pixels", film.each(index), (*size, 3), np.uint8)
        ctx.check(len(found[index]) > 0, f"episode `{index}` has no picture")
        if film.depth:
            depth[index] = _mapped(ctx.scratch / f"{number}.depth", film.each_depth(index), size, np.uint16)
        ctx.progress(number + 1, len(film.frames), "episodes")
    frames = sum(len(each) for each in found.values())
    megabytes = sum(each.nbytes for each in (*found.values(), *depth.values())) / 1e6
    ctx.metric("size", megabytes, "MB")
    what = f"{film.width} x {film.height} px" + (" with depth" if depth else "")
    ctx.say(f"{len(found)} episodes, {frames:,} pictures of {what}, {megabytes:,.0f} MB")
    return Pixels(episodes=found, depth=depth, camera=film.camera, view=film.view)


def _mapped(file: Path, frames: Iterator[np.ndarray], shape: tuple[int, ...], kind: type[np.generic]) -> np.ndarray:
    """The frames (T, ...), in a file."""
    with file.open("wb") as out:
        count = sum(1 for frame in frames if out.write(frame.tobytes()))
    mapped = np.memmap(file, kind, "r", shape=(count, *shape)) if count else np.zeros((0, *shape), kind)
    return np.asarray(mapped)
