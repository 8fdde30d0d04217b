"""Videos and recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png, smaller
from dextera_build.artifacts.cameras.mask_track import MaskTrack, palette
from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.formats import mcap
from dextera_build.geometry.plot import COLOURS, Line, plot
from dextera_build.previews.images import beside_plot, grey


def _facts_of_stream(stream: Stream) -> Iterator[str]:
    """Duration, number of messages, topics."""
    yield f"{stream.duration_s():.2f} s"
    yield f"{sum(each.count for each in stream.channels):,} messages"
    yield f"{len(stream.channels)} topics ({', '.join(each.topic for each in stream.channels[:6])})"


def _picture_of_stream(stream: Stream) -> bytes:
    """Ten seconds of the first joint states, and the first picture next to them."""
    views: list[np.ndarray] = []
    for each in stream.channels:
        if each.kind in mcap.JOINTS and each.count and not views:
            first = mcap.joints(stream, each.topic, end=stream.start_ns / 1e9 + 10)
            lines = [
                Line(np.stack([first.stamps, column], axis=1), COLOURS[number % len(COLOURS)])
                for number, column in enumerate(first.positions.T)
            ]
            views.append(plot(lines, "t [s]", "[rad]"))
    seen = next((each.topic for each in stream.channels if each.kind in mcap.PICTURES and each.count), None)
    if seen is not None:
        views.append(beside_plot(next(mcap.pictures(stream, seen))[1]))
    return png(np.hstack(views or [plot([], "t [s]", "")]))


def _facts_of_video(video: Video) -> Iterator[str]:
    """Size, number of frames, duration and distance of key frames."""
    yield f"{video.width} x {video.height} px"
    yield f"{len(video.stamps):,} frames"
    yield f"{video.stamps[-1] - video.stamps[0]:.2f} s"
    yield f"a key frame every {len(video.stamps) / video.is_key.sum():.3g}"


def _picture_of_video(video: Video) -> bytes:
    """The first, the middle and the last frame."""
    last = len(video.stamps) - 1
    shown = [smaller(frame, 320) for frame in video.frames([0, last // 2, last])]
    return png(np.hstack(shown))


def _facts_of_mask_track(track: MaskTrack) -> Iterator[str]:
    """Size, number of frames, duration, and number of frames in which each object is visible."""
    yield f"{track.width} x {track.height} px"
    yield f"{len(track.stamps):,} frames"
    yield f"{track.stamps[-1] - track.stamps[0]:.2f} s"
    for name, count in zip(track.names, track.seen.sum(axis=0), strict=True):
        yield f"{name} in {count:,}"


def _picture_of_mask_track(track: MaskTrack) -> bytes:
    """The first, the middle and the last frame, one colour for each object."""
    last = len(track.stamps) - 1
    shown = [smaller(palette()[labels], 320) for labels in map(track.labels, (0, last // 2, last))]
    return png(np.hstack(shown))


def _facts_of_rgbd_video(video: RgbdVideo) -> Iterator[str]:
    """Size, number of frames, duration, and whether the camera's motion is known."""
    yield f"{video.camera.width} x {video.camera.height} px"
    yield f"{len(video.stamps):,} frames"
    yield f"{video.stamps[-1] - video.stamps[0]:.2f} s"
    if video.poses is not None:
        yield f"T_{video.frame}_camera"


def _picture_of_rgbd_video(video: RgbdVideo) -> bytes:
    """The first, the middle and the last frame, colour above depth."""
    last = len(video.stamps) - 1
    shown = [
        np.vstack([smaller(frame.rgb, 320), np.repeat(smaller(grey(frame.depth), 320)[..., None], 3, axis=2)])
        for frame in video.frames([0, last // 2, last])
    ]
    return png(np.hstack(shown))


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    Stream: _facts_of_stream,
    Video: _facts_of_video,
    MaskTrack: _facts_of_mask_track,
    RgbdVideo: _facts_of_rgbd_video,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    Stream: _picture_of_stream,
    Video: _picture_of_video,
    MaskTrack: _picture_of_mask_track,
    RgbdVideo: _picture_of_rgbd_video,
}
