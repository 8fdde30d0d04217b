"""demonstrate.unpack: decode a film once, for learners that read its pictures in random order many times."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Film
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy",))
def unpack(ctx: Context, film: Film) -> Pixels:
    """Return the pictures (T, H, W, 3) uint8 of every episode, decoded; the store memory-maps them."""
    shape, found = (film.height, film.width, 3), {}
    for number, index in enumerate(film.frames):
        file = ctx.scratch / f"{number}.pixels"
        with file.open("wb") as out:
            count = sum(1 for frame in film.each(index) if out.write(frame.tobytes()))
        ctx.check(count > 0, f"episode `{index}` has no picture")
        found[index] = np.asarray(np.memmap(file, np.uint8, "r", shape=(count, *shape)))
        ctx.progress(number + 1, len(film.frames), "episodes")
    frames = sum(len(each) for each in found.values())
    size = sum(each.nbytes for each in found.values()) / 1e6
    ctx.metric("size", size, "MB")
    ctx.say(f"{len(found)} episodes, {frames:,} pictures of {film.width} x {film.height} px, {size:,.0f} MB")
    return Pixels(episodes=found)
