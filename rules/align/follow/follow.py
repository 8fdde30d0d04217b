"""align.follow: masks of objects through a video, from a label map of one of its frames."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt

from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.mask_track import MaskTrack, palette
from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.objects.view import InstanceMap, Segmentation
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from . import parts


class FollowOptions(Options):
    """Options of align.follow."""

    names: tuple[str, ...] = ()
    """Names of labels 1, 2, ... of a label map; by default `1`, `2`, ... A segmentation has its own names."""
    frame: NonNegativeInt = 0
    """Number of the frame that the label map belongs to; earlier frames are followed backwards."""


class FollowBackend(Protocol):
    """Interface of a backend of align.follow."""

    def follow(self, ctx: Context, video: Video, first: np.ndarray, names: tuple[str, ...], options: Any) -> MaskTrack:
        """The masks of all frames; `first` (H, W) uint8 has the labels of the first frame, which are kept."""
        ...


@rule(version=3, packages=("av", "numpy", "pillow"))
def follow(
    ctx: Context[FollowBackend],
    video: Video | RgbdVideo,
    first: Segmentation | InstanceMap | LabelImage,
    *,
    options: FollowOptions | None = None,
) -> MaskTrack:
    """Return the mask of each object of the label map `first` in every frame; a lost object has an empty mask.

    The depth of an RGB-D video is not used.
    """
    options = options or FollowOptions()
    labels, names = _objects(ctx, first, options.names)
    height, width = parts.size(video)
    if labels.shape != (height, width):
        ctx.fail(
            "the label map is not of the size of the video",
            labels=f"{labels.shape[1]} x {labels.shape[0]} px",
            video=f"{width} x {height} px",
            hint="make it from a frame of this video",
        )
    count = len(video.stamps)
    ctx.check(options.frame < count, f"the video has no frame {options.frame}", frames=f"0 to {count - 1}")
    if isinstance(video, RgbdVideo) or options.frame:
        later = parts.part(ctx, video, range(options.frame, count), "after")
    else:
        later = video
    after, before = _followed(ctx, later, labels, names), None
    if options.frame:
        before = _followed(ctx, parts.part(ctx, video, range(options.frame, -1, -1), "before"), labels, names)
    found = parts.joined(after, before, video.stamps)
    ctx.say(_summary(found))
    ctx.metric("seen", float(found.seen.mean()), "fraction")
    ctx.preview(_overlay(video, found), "first, middle and last frame")
    return found


def _followed(ctx: Context[FollowBackend], video: Video, labels: np.ndarray, names: tuple[str, ...]) -> MaskTrack:
    """The backend's masks of a video that begins with the labelled frame, checked."""
    found = ctx.backend.follow(ctx, video, labels.astype(np.uint8), names, ctx.backend_options)
    fits = (found.height, found.width) == labels.shape and np.array_equal(found.stamps, video.stamps)
    ctx.check(
        fits and found.names == names,
        "the masks are not of the size, the frames or the objects that were asked for",
        masks=", ".join(found.facts()),
        video=", ".join(video.facts()),
    )
    ctx.check(np.array_equal(found.labels(0), labels), "the first frame is not the label map that was given")
    return found


def _objects(
    ctx: Context[Any], first: Segmentation | InstanceMap | LabelImage, stated: tuple[str, ...]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Labels (H, W) int32 and the name of each."""
    labels = first.map.labels if isinstance(first, Segmentation) else first.labels
    if isinstance(first, Segmentation) and stated:
        ctx.fail("the segmentation has names already", names=listing(first.names), hint="leave out `names`")
    low, high = int(labels.min(initial=0)), int(labels.max(initial=0))
    if low < 0 or not 0 < high <= 255:
        ctx.fail(
            "the label map has no objects that can be followed",
            labels=f"{low} to {high}",
            hint="0 is everything else, 1 to 255 are objects",
        )
    names = first.names if isinstance(first, Segmentation) else stated or tuple(map(str, range(1, high + 1)))
    if len(set(names)) != len(names) or len(names) < high:
        ctx.fail(
            "the names are not those of the labels",
            names=listing(names),
            labels=f"1 to {high}",
            hint="`names` lists one for each label, all different",
        )
    return labels, names


def _summary(found: MaskTrack) -> str:
    last = [int(np.flatnonzero(seen).max(initial=-1)) for seen in found.seen.T]
    gone = [
        f"{name} not seen after {found.stamps[number]:.2f} s" if number >= 0 else f"{name} never seen"
        for name, number in zip(found.names, last, strict=True)
        if number < len(found.stamps) - 1
    ]
    count = len(found.names)
    return "; ".join([f"{count} object{'s' * (count > 1)} through {len(found.stamps):,} frames", *gone])


def _overlay(video: Video | RgbdVideo, found: MaskTrack) -> np.ndarray:
    """Three frames with the masks in the colours of their labels, (H, 3 W, 3) uint8."""
    last = len(found.stamps) - 1
    drawn = []
    shown = [0, last // 2, last]
    for number, pixels in zip(shown, parts.pictures(video, shown), strict=True):
        labels = found.labels(number)
        mixed = pixels // 2 + palette()[labels] // 2
        drawn.append(np.where(labels[..., None] > 0, mixed, pixels))
    return np.hstack(drawn)
