"""Encoded video with random access by frame number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, BinaryIO, Self

import numpy as np
from pydantic import PositiveInt, model_validator

from dextera_build.artifacts.base import Array, Artifact, File
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.errors import ArtifactError


class Video(Artifact):
    """A video file and its index. Frames are decoded on access; the file is not loaded as a whole."""

    file: File
    """The file; its first video stream is used."""
    width: PositiveInt
    """Width of a frame [px]."""
    height: PositiveInt
    """Height of a frame [px]."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Time of each frame from the beginning of the stream, increasing."""
    is_key: Annotated[np.ndarray, Array("N", "bool")]
    """Whether decoding can begin with this frame; always true for the first one."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.stamps) or not self.is_key[0] or (np.diff(self.stamps) <= 0).any():
            raise ArtifactError(
                "Video: its index does not begin with a key frame, or its times do not increase",
                code="DXB-A521",
                hint="encode it again: `ffmpeg -i OLD -c:v libx264 NEW.mp4`",
            )
        return self

    @classmethod
    def of(cls, file: File, name: str = "video.mp4") -> Video:
        """The video in a file; its packets are read once for the index, and nothing is decoded.

        Args:
            file: The file.
            name: Its name, for errors.

        Raises:
            ArtifactError: It is no video, or its first frame is not a key frame.
        """
        with _opened(file, name) as (container, stream):
            found = sorted((packet.pts, packet.is_keyframe) for packet in container.demux(stream) if packet.size)
            unit, size = float(stream.time_base), (stream.width, stream.height)
        stamps = np.array([time * unit for time, _ in found], np.float64)
        is_key = np.array([key for _, key in found], bool)
        return cls(file=file, width=size[0], height=size[1], stamps=stamps, is_key=is_key)

    def frames(self, numbers: Sequence[int]) -> np.ndarray:
        """Frames by number, (len(numbers), H, W, 3) uint8 sRGB, in the requested order.

        At most the frames from the key frame before each are decoded.

        Raises:
            ArtifactError: There is no such frame, or the file is damaged.
        """
        wanted = np.asarray(numbers, np.int64).reshape(-1)
        wrong = wanted[(wanted < 0) | (wanted >= len(self.stamps))]
        if len(wrong):
            raise ArtifactError(
                f"the video has no frame {wrong[0]}", code="DXB-A522", facts={"frames": f"0 to {len(self.stamps) - 1}"}
            )
        found = np.empty((len(wanted), self.height, self.width, 3), np.uint8)
        for number, pixels in self._decoded(np.unique(wanted)):
            found[wanted == number] = pixels
        return found

    def every(self) -> Iterator[np.ndarray]:
        """All frames (H, W, 3) uint8 sRGB in order, one at a time."""
        for _, pixels in self._decoded(np.arange(len(self.stamps))):
            yield pixels

    def packets(self) -> Iterator[tuple[bytes, bool]]:
        """Coded data of each frame in order of decoding, and whether it is a key frame.

        The data are those of the container. H.264 in MP4 has a length prefix before each unit and stores the parameter
        sets separately (AVCC); a decoder of plain H.264 expects start codes (Annex B), which the bit stream filter
        `h264_mp4toannexb` of FFmpeg writes.
        """
        with _opened(self.file, "video.mp4") as (container, stream):
            for packet in container.demux(stream):
                if packet.size:
                    yield bytes(packet), bool(packet.is_keyframe)

    def _decoded(self, numbers: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Number and pixels of frames, whose numbers increase."""
        keys = np.flatnonzero(self.is_key)
        with _opened(self.file, "video.mp4") as (container, stream):
            middles = (self.stamps[1:] + self.stamps[:-1]) / 2
            decoder: Iterator[Any] = iter(())
            at = -2  # the last decoded frame
            for number in numbers:
                key = keys[np.searchsorted(keys, number, side="right") - 1]
                if key > at + 1 or at > number or at == -2:
                    container.seek(round(self.stamps[key] / stream.time_base), stream=stream)
                    decoder = container.decode(stream)
                while True:
                    frame = next(decoder, None)
                    if frame is not None:
                        at = int(np.searchsorted(middles, float(frame.pts * stream.time_base)))
                    if frame is None or at > number:
                        raise unreadable("video.mp4", "a video", f"frame {number} of its index is missing")
                    if at == number:
                        break
                yield int(number), frame.to_ndarray(format="rgb24")


@contextmanager
def _opened(file: File, name: str) -> Iterator[tuple[Any, Any]]:
    """The container and its first video stream, on one thread.

    Raises:
        ArtifactError: The file is no video, or is damaged where it is read.
    """
    import av

    try:
        with file.open() as raw, av.open(raw, stream_options=_opening(raw)) as container:
            if not container.streams.video:
                raise unreadable(name, "a video", "it has no picture stream")
            stream = container.streams.video[0]
            stream.thread_count = 1
            yield container, stream
    except av.FFmpegError as error:
        raise unreadable(name, "a video", error) from None


def _opening(raw: BinaryIO) -> Any:
    """Options with which FFmpeg opens a file: an MP4 states size and order of its frames, so none is decoded."""
    begin = raw.read(8)
    raw.seek(0)
    return [{"skip_frame": "all"}] if begin[4:] == b"ftyp" else None
