"""Chooses the quality of a report's pictures: the finest at which the page is small enough."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence

from dextera_build.report.films import Films
from dextera_build.report.pictures import LADDER, Pictures, Size, Sketch, Told
from dextera_build.report.sources import Store

SAMPLE = 24
"""Number of pictures of each size that are compressed at every quality, to estimate the bytes of all."""


def fitted(
    draw: Callable[[Pictures, Films | None], str], store: Store, films: Films, limit: int, told: Told | None = None
) -> str:
    """The page at the finest quality at which it has at most `limit` bytes, else at the coarsest.

    Bytes at each quality are estimated from a sample, so that thousands of pictures are compressed once, and not once
    per quality. Films go first, then pictures become coarser.

    Args:
        draw: Makes the page of pictures, and of films or pictures in their place.
        store: Of the pictures.
        films: Of the finest quality.
        limit: In bytes.
        told: Hears how many pictures are compressed, of how many.
    """
    sketch = Sketch(store)
    bare = len(draw(sketch, None).encode())
    levels = [Pictures(store, quality, len(sketch.wanted), told) for quality in LADDER]
    text = ""
    for level in levels[_first(levels, sketch.wanted, limit - bare) :]:
        for shown in (films, None) if level is levels[0] else (None,):
            text = draw(level, shown)
            if len(text.encode()) <= limit:
                return text
    return text


def _first(levels: Sequence[Pictures], wanted: Counter[tuple[str, Size]], limit: int) -> int:
    """The first level whose pictures take at most `limit` bytes, by a sample; the last one if there is none."""
    of_size: dict[Size, list[str]] = defaultdict(list)
    for digest, size in sorted(wanted):
        of_size[size].append(digest)
    for number, level in enumerate(levels[:-1]):
        bytes_ = 0.0
        for size, digests in of_size.items():
            sample = digests[:: -(-len(digests) // SAMPLE)]
            mean = sum(len((level.uri(digest, size) or ("",))[0]) for digest in sample) / len(sample)
            bytes_ += mean * sum(wanted[digest, size] for digest in digests)
        if bytes_ <= limit:
            return number
    return len(levels) - 1
