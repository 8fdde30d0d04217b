"""The two parts of a video before and after the frame whose masks are known, and the masks of both together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.cameras.video import Video
from dextera_build.formats import video as video_files
from dextera_build.rule import Context

QUALITY = 8
"""Quantisation parameter of an encoded part, nearly without loss: colours decide which pixel belongs to an object."""
RATE_HZ = 30.0
"""Frame rate of an encoded part; its masks get the times of the original."""


def part(ctx: Context[Any], video: Video | RgbdVideo, numbers: Sequence[int], name: str) -> Video:
    """The colour pictures of some frames as a video; raises for a size that no encoder takes."""
    height, width = size(video)
    ctx.check(
        height % 2 == 0 and width % 2 == 0,
        "a video of odd width or height cannot be encoded",
        video=f"{width} x {height} px",
        hint="crop its frames by one row or column, and correct `cx` and `cy`",
    )
    encoder = video_files.encoder(width, height, RATE_HZ, qp=QUALITY)
    return video_files.write(ctx.scratch / f"{name}.mp4", pictures(video, numbers), encoder)


def size(video: Video | RgbdVideo) -> tuple[int, int]:
    """Height and width of a frame [px]."""
    shown = video.camera if isinstance(video, RgbdVideo) else video
    return shown.height, shown.width


def pictures(video: Video | RgbdVideo, numbers: Sequence[int]) -> Iterator[np.ndarray]:
    """Colour pictures (H, W, 3) uint8 of some frames."""
    if isinstance(video, RgbdVideo):
        for frame in video.frames(numbers):
            yield frame.rgb
    else:
        for number in numbers:
            yield video.frames([number])[0]


def joined(after: MaskTrack, before: MaskTrack | None, stamps: np.ndarray) -> MaskTrack:
    """Masks in the order of the original: those of `before`, whose frames run backwards, and then those of `after`."""
    if before is None:
        return after.model_copy(update={"stamps": stamps, "first": 0})
    # Both parts begin with the same frame.
    frames = [(before, number) for number in range(len(before.stamps) - 1, 0, -1)]
    first = len(frames)
    frames += [(after, number) for number in range(len(after.stamps))]
    pairs = ((each.labels(number), None if each.scores is None else each.scores[number]) for each, number in frames)
    return MaskTrack.of(after.names, stamps, pairs, first)
