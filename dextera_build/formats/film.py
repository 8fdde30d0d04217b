"""`Film` as animated PNGs, or as one MP4."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dextera_build.artifacts.tasks.episode import Film
from dextera_build.formats import video

_RATE_HZ = 20.0
"""Frames per second at which a film plays; it states none."""


def export(film: Film, folder: Path, stem: str) -> list[Path]:
    """Write `stem/<index>.png`, an animated PNG per episode."""
    from PIL import Image

    (folder / stem).mkdir(parents=True, exist_ok=True)
    written = []
    for index in film.frames:
        first, *rest = [Image.fromarray(frame) for frame in film.each(index)]
        written.append(folder / stem / f"{index}.png")
        first.save(written[-1], save_all=True, append_images=rest, duration=round(1000 / _RATE_HZ), loop=0)
    return written


def save(film: Film, path: Path) -> list[Path]:
    """Write the episodes, one after the other, as an `.mp4`; a last odd row or column of pixels is left out."""
    height, width = film.height // 2 * 2, film.width // 2 * 2

    def frames() -> Iterator[np.ndarray]:
        for index in film.frames:
            yield from (frame[:height, :width] for frame in film.each(index))

    video.encoder(width, height, _RATE_HZ).write(path, frames())
    return [path]
