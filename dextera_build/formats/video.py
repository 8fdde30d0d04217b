"""`Video` as MP4."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.video import Video
from dextera_build.formats.files import suffix_among
from dextera_build.formats.h264 import Encoder


def save(video: Video, path: Path) -> list[Path]:
    """Write the file as it is."""
    video.file.place(path)
    return [path]


def load(path: str | Path) -> Video:
    """Open an `.mp4`, `.mkv` or `.mov` file, which must no longer change.

    Raises:
        ArtifactError: It is no video.
    """
    suffix_among("Video", Path(path), (".mp4", ".mkv", ".mov"))
    return Video.of(File.of(path), Path(path).name)


def write(path: str | Path, frames: Iterable[np.ndarray], encoder: Encoder) -> Video:
    """Encode frames (H, W, 3) uint8 sRGB, one by one, into the `.mp4` file `path`, and open it."""
    encoder.write(Path(path), frames)
    return load(path)


def encoder(width: int, height: int, rate_hz: float, *, qp: int = 24, keyframe_every: int = 10) -> Encoder:
    """An encoder for `write`, fast and of high quality.

    Args:
        width: Even width of a frame [px].
        height: Even height of a frame [px].
        rate_hz: Frames per second.
        qp: Quantisation parameter, 1 (best) to 51.
        keyframe_every: Key frame interval: how many frames are decoded to read one, at most.
    """
    rate = Fraction(rate_hz).limit_denominator(1001)
    return Encoder(width, height, rate, qp, keyframe_every, preset="veryfast")
