"""Rendered episodes as a film, with its preview."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import View
from dextera_build.policy.features import counts
from dextera_build.policy.observation import Frame
from dextera_build.rule import Context

from .film_strip import strip


def film_of(
    ctx: Context, episodes: Episodes, view: View, taken: Iterator[tuple[str, Frame]], strip_frames: int
) -> Film:
    """The film of all kept episodes, packed as they come.

    Args:
        ctx: Its scratch folder holds the frames.
        episodes: The episodes.
        view: The camera of the frames.
        taken: Index of each kept episode, and its frames with a leading axis of T steps.
        strip_frames: Frames in the preview of the first episode.

    Raises:
        RuleError: An episode has no frames, or another number than steps.
    """
    camera, packed, depth = view.camera, dict[str, Path](), dict[str, Path]()
    count = 0
    for index, frame in taken:
        pixels = np.asarray(frame.rgb)
        expected = (len(episodes.items[index].joints), camera.height, camera.width, 3)
        ctx.check(pixels.shape == expected, "an episode has another number of frames than steps", episode=index)
        if not packed:
            failed = f", failed: {reason}" if (reason := episodes.items[index].reason) else ""
            ctx.preview(strip(pixels, strip_frames), f"{episodes.task}, episode {index}{failed}")
        packed[index] = ctx.scratch / f"{len(packed)}.packed"
        packed[index].write_bytes(Film.packed(pixels))
        if frame.depth is not None:
            depth[index] = ctx.scratch / f"{len(packed)}.depth"
            depth[index].write_bytes(Film.packed(counts(frame.depth)))
        count += len(pixels)
        ctx.progress(len(packed), len(episodes.items), "episodes")
    ctx.check(packed.keys() == episodes.items.keys(), "an episode has no frames")
    ctx.check(not depth or depth.keys() == packed.keys(), "an episode has no depth")
    megabytes = sum(path.stat().st_size for path in (*packed.values(), *depth.values())) / 1e6
    ctx.metric("size", megabytes, "MB")
    plural = "" if len(packed) == 1 else "s"
    size = f"{camera.width} x {camera.height} px" + (" with depth" if depth else "")
    ctx.say(f"{len(packed)} episode{plural}, {count:,} frames of {size}, {megabytes:.1f} MB")
    return Film.of(packed, camera.width, camera.height, depth, camera if depth else None, view)
