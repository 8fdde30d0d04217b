"""demonstrate.film: render recorded episodes through a camera."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.episode import Episodes, Film
from dextera_build.artifacts.task import TaskBundle, View
from dextera_build.rule import Context, Options, rule

from .film_strip import strip


class FilmOptions(Options):
    """Options of demonstrate.film."""

    strip_frames: PositiveInt = 8
    """Frames in the preview of the first episode."""


class FilmBackend(Protocol):
    """What a backend of demonstrate.film defines."""

    def frames(
        self, ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, options: Any
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Index and frames (T, H, W, 3) uint8 of each episode."""
        ...


@rule(version=1, packages=("numpy",))
def film(
    ctx: Context[FilmBackend], bundle: TaskBundle, episodes: Episodes, view: View, *, options: FilmOptions
) -> Film:
    """Return one frame (H, W, 3) uint8 sRGB per step of every kept episode, seen through `view`.

    Recorded states are rendered, nothing is simulated; frame t is the scene before action t.
    """
    camera = view.camera
    packed: dict[str, Path] = {}
    count = 0
    taken: Iterator[tuple[str, np.ndarray]] = ctx.backend.frames(ctx, bundle, episodes, view, ctx.backend_options)
    for index, pixels in taken:
        expected = (len(episodes.items[index].joints), camera.height, camera.width, 3)
        ctx.check(pixels.shape == expected, "an episode has another number of frames than steps", episode=index)
        if not packed:
            ctx.preview(strip(pixels, options.strip_frames), f"{episodes.task}, episode {index}")
        packed[index] = ctx.scratch / f"{len(packed)}.packed"
        packed[index].write_bytes(Film.packed(pixels))
        count += len(pixels)
        ctx.progress(len(packed), len(episodes.items), "episodes")
    ctx.check(packed.keys() == episodes.items.keys(), "an episode has no frames")
    megabytes = sum(path.stat().st_size for path in packed.values()) / 1e6
    ctx.metric("size", megabytes, "MB")
    ctx.say(f"{len(packed)} episodes, {count:,} frames of {camera.width} x {camera.height} px, {megabytes:.1f} MB")
    return Film.of(packed, camera.width, camera.height)
