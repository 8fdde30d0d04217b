"""Draw boxes and outlines on a photograph, for the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.objects.object import Element

COLOURS = ((230, 60, 60), (60, 160, 240), (250, 190, 40), (90, 200, 90), (190, 90, 220), (255, 130, 40), (40, 200, 190))
STATIC = (150, 150, 150)


def boxes(pixels: np.ndarray, elements: Sequence[Element]) -> np.ndarray:
    """A copy of (H, W, 3) uint8 with each element's box and name; static ones in gray."""
    from PIL import Image, ImageDraw

    picture = Image.fromarray(pixels)
    draw = ImageDraw.Draw(picture)
    for number, element in enumerate(elements):
        if element.box is None:
            continue
        colour = COLOURS[number % len(COLOURS)] if element.interactive else STATIC
        left, top, right, bottom = element.box
        draw.rectangle((left, top, right - 1, bottom - 1), outline=colour, width=2)
        _tag(draw, (left + 2, max(0, top - 13)), element.name, colour)
    return np.array(picture)


def named(pixels: np.ndarray, labels: np.ndarray, points: Mapping[str, tuple[int, int]]) -> np.ndarray:
    """The outlines of labels 1, 2, ... of (H, W), with the name of each and its point (column, row) [px]."""
    from PIL import Image, ImageDraw

    picture = Image.fromarray(outlines(pixels, labels))
    draw = ImageDraw.Draw(picture)
    for number, (name, (column, row)) in enumerate(points.items()):
        _tag(draw, (column, row), f"{name} [{column}, {row}]", COLOURS[number % len(COLOURS)])
    return np.array(picture)


def _tag(draw: Any, place: tuple[int, int], text: str, colour: tuple[int, int, int]) -> None:
    ends = draw.textbbox(place, text)
    draw.rectangle((ends[0] - 2, ends[1] - 1, ends[2] + 2, ends[3] + 1), fill=colour)
    draw.text(place, text, fill=(0, 0, 0))


def outlines(pixels: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """A copy of (H, W, 3) uint8 with each label's pixels tinted and its border drawn."""
    marked = pixels.astype(np.float32)
    for number in [int(n) for n in np.unique(labels) if n]:
        mask = labels == number
        colour = np.array(COLOURS[(number - 1) % len(COLOURS)], np.float32)
        inner = mask.copy()
        inner[1:] &= mask[:-1]
        inner[:-1] &= mask[1:]
        inner[:, 1:] &= mask[:, :-1]
        inner[:, :-1] &= mask[:, 1:]
        marked[inner] = 0.7 * marked[inner] + 0.3 * colour
        marked[mask & ~inner] = colour
    return np.asarray(marked.astype(np.uint8))
