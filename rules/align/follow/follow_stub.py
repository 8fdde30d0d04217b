"""Backend stub of align.follow: nothing moves, for tests."""

from __future__ import annotations

import itertools

import numpy as np

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.video import Video
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the masks of the first frame in all frames, for tests", profiles=("stub",))


def follow(ctx: Context, video: Video, first: np.ndarray, names: tuple[str, ...], options: Options) -> MaskTrack:
    """The label map of the first frame, repeated for all frames."""
    return MaskTrack.of(names, video.stamps, itertools.repeat((first, None), len(video.stamps)))
