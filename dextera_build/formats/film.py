"""`Film` as animated PNGs."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.tasks.episode import Film


def export(film: Film, folder: Path, stem: str) -> list[Path]:
    """Write `stem/<index>.png`, an animated PNG per episode."""
    from PIL import Image

    (folder / stem).mkdir(parents=True, exist_ok=True)
    written = []
    for index in film.frames:
        first, *rest = [Image.fromarray(frame) for frame in film.each(index)]
        written.append(folder / stem / f"{index}.png")
        first.save(written[-1], save_all=True, append_images=rest, duration=50, loop=0)
    return written
