"""Backend flow of align.follow: masks move with the optical flow inside them and are compared with the first frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.video import Video
from dextera_build.rule import Backend, Context

from .flow_layers import Layer, Picture
from .flow_motion import flow
from .flow_options import FlowOptions

BACKEND = Backend(
    summary="DIS optical flow, one affine motion per object and frame",
    profiles=("cpu",),
    packages=("opencv-python-headless",),
    extra="twin",
)


def follow(ctx: Context, video: Video, first: np.ndarray, names: tuple[str, ...], options: FlowOptions) -> MaskTrack:
    """Masks by affine motions; a pixel claimed by two objects belongs to the one with the smaller colour difference.

    Occluded and reappearing pixels are detected by their colours. A lost object is not recovered. The score is the
    fraction of consistent flow inside an object times the visible fraction of its moved outline.
    """
    return MaskTrack.of(names, video.stamps, _frames(ctx, video, first, len(names), options))


def _frames(
    ctx: Context, video: Video, first: np.ndarray, count: int, options: FlowOptions
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Labels (H, W) uint8 and scores (K,) of each frame."""
    frames = video.every()
    before = Picture.of(next(frames))
    layers = [Layer.of(before, first == number) for number in range(1, count + 1)]
    yield first, np.array([layer.visible.any() for layer in layers], np.float32)
    for done, pixels in enumerate(frames, 1):
        ctx.progress(done, len(video.stamps), "frames")
        now = Picture.of(pixels)
        way = flow(before.grey, now.grey)
        moved = [layer.move(now, way, options) for layer in layers]
        off = np.stack([each for each, _ in moved])
        labels = np.where(np.isfinite(off).any(0), off.argmin(0) + 1, 0).astype(np.uint8)
        for number, layer in enumerate(layers, 1):
            layer.visible = labels == number
        scores = [share * layer.seen for layer, (_, share) in zip(layers, moved, strict=True)]
        yield labels, np.array(scores, np.float32)
        before = now
