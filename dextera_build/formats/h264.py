"""H.264 in MP4 with deterministic bytes: one thread, own colour conversion, one quantiser, no wall clock."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

_CONSTANT = "cpu-independent=1:mbtree=0:aq-mode=0:weightp=0:rc-lookahead=0:scenecut=0"
"""Options of x264 with which all blocks have the same quantiser.

Adaptive quantisation (floating-point numbers, a look-ahead) is not deterministic: two encodings of the same pictures in
one process differed in the last blocks. At a short key frame interval it has no benefit: a moving picture of 640 x 480
px with a key frame every 5 has the same PSNR with `qp` 22 (46.0 dB, 7.9 kB a frame) as with `crf` 18 and all options on
(45.9 dB, 8.7 kB).
"""


@dataclass(frozen=True)
class Clip:
    """The encoded frames of one episode; starts with a key frame and references no earlier frames."""

    packets: list[tuple[bytes, bool]]
    """Data of each frame in order, and whether it is a key frame."""

    @property
    def size(self) -> int:
        """Size [bytes]."""
        return sum(len(data) for data, _ in self.packets)


@dataclass(frozen=True)
class Encoder:
    """Encoder settings. Clips of one encoder can be joined in one file.

    Args:
        width: Even width of a frame [px].
        height: Even height of a frame [px].
        rate: Frames per second.
        qp: Quantisation parameter of predicted frames, 1 (best) to 51; that of key frames is 3 lower.
        keyframe_every: Key frame interval.
        preset: Effort of x264, which trades time for size.
    """

    width: int
    height: int
    rate: Fraction
    qp: int
    keyframe_every: int
    preset: str = "medium"

    def write(self, path: Path, frames: Iterable[np.ndarray]) -> None:
        """Encode frames (H, W, 3) uint8 sRGB into an MP4 file, holding one at a time."""
        import av

        with av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact"}) as out:
            stream: Any = out.add_stream("libx264", rate=self.rate)
            self._set(stream.codec_context)
            for number, pixels in enumerate(frames):
                frame = av.VideoFrame.from_ndarray(yuv420(pixels[None])[0], format="yuv420p")
                frame.pts, frame.time_base = number, 1 / self.rate
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))

    def encode(self, pixels: Iterable[np.ndarray]) -> Clip:
        """Encode frames (H, W, 3) uint8 sRGB at constant frame rate, holding one at a time."""
        import av

        coder = av.CodecContext.create("libx264", "w")
        self._set(coder)
        coder.framerate = self.rate
        packets = []
        for number, picture in enumerate(pixels):
            frame = av.VideoFrame.from_ndarray(yuv420(picture[None])[0], format="yuv420p")
            frame.pts, frame.time_base = number, 1 / self.rate
            packets += coder.encode(frame)
        packets += coder.encode(None)
        return Clip([(bytes(packet), bool(packet.is_keyframe)) for packet in packets])

    def stream(self, pixels: Iterable[np.ndarray]) -> Iterator[bytes]:
        """Encode frames (H, W, 3) uint8 sRGB as Annex B, one at a time; every key frame has the parameter sets."""
        import av

        coder = av.CodecContext.create("libx264", "w")
        self._set(coder, header=False)
        coder.options |= {"tune": "zerolatency"}
        coder.framerate = self.rate
        for number, picture in enumerate(pixels):
            frame = av.VideoFrame.from_ndarray(yuv420(picture[None])[0], format="yuv420p")
            frame.pts, frame.time_base = number, 1 / self.rate
            yield from map(bytes, coder.encode(frame))
        yield from map(bytes, coder.encode(None))

    @contextmanager
    def joined(self, path: Path) -> Iterator[Callable[[Clip], None]]:
        """A function that appends clips to a new MP4 file; frame n of the file starts at n / rate."""
        import av

        with av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact"}) as out:
            stream: Any = out.add_stream("libx264", rate=self.rate)
            self._set(stream.codec_context)
            out.start_encoding()
            numbers = itertools.count()

            def add(clip: Clip) -> None:
                for data, key in clip.packets:
                    packet = av.Packet(data)
                    packet.stream, packet.time_base = stream, 1 / self.rate
                    packet.pts = packet.dts = next(numbers)
                    packet.duration, packet.is_keyframe = 1, key
                    out.mux(packet)

            yield add

    def _set(self, coder: Any, *, header: bool = True) -> None:
        from av.codec.context import Flags

        coder.width, coder.height, coder.pix_fmt = self.width, self.height, "yuv420p"
        coder.time_base, coder.thread_count = 1 / self.rate, 1
        coder.flags |= Flags.bitexact
        if header:  # the parameter sets are in the header of the file, not in the stream
            coder.flags |= Flags.global_header
        # Without B-frames, coding order and display order are the same.
        coder.options = {"qp": str(self.qp), "g": str(self.keyframe_every), "bf": "0", "preset": self.preset} | {
            "x264-params": _CONSTANT
        }


def yuv420(pixels: np.ndarray) -> np.ndarray:
    """Convert frames (T, H, W, 3) uint8 sRGB to planes (T, 3 H / 2, W) uint8: BT.601, limited range, averaged chroma.

    ffmpeg's conversion gives different bytes on different processors.
    """
    steps, height, width, _ = pixels.shape
    r, g, b = (pixels[..., channel].astype(np.uint16) for channel in range(3))
    luma = (66 * r + 129 * g + 25 * b + 128 >> 8) + 16  # at most 56,228 before the shift
    r, g, b = (_sums(plane) for plane in (r, g, b))
    blue = (-38 * r - 74 * g + 112 * b + 512 >> 10) + 128
    red = (112 * r - 94 * g - 18 * b + 512 >> 10) + 128
    flat = [plane.reshape(steps, -1).astype(np.uint8) for plane in (luma, blue, red)]
    return np.concatenate(flat, axis=1).reshape(steps, 3 * height // 2, width)


def _sums(plane: np.ndarray) -> np.ndarray:
    """Sums (T, H / 2, W / 2) int32 of 2 x 2 pixels."""
    rows = plane[:, 0::2] + plane[:, 1::2]
    sums: np.ndarray = (rows[:, :, 0::2] + rows[:, :, 1::2]).astype(np.int32)
    return sums
