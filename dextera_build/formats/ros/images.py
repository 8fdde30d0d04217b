"""Pixels of image messages: colours, and depth in metres."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable

_ENCODINGS = {
    **{name: (3, [0, 1, 2]) for name in ("rgb8", "8UC3")},
    "bgr8": (3, [2, 1, 0]),
    "rgba8": (4, [0, 1, 2]),
    "bgra8": (4, [2, 1, 0]),
}
"""Encoding of `sensor_msgs/Image` -> bytes per pixel, and positions of red, green and blue among them."""
_GREY = ("mono8", "8UC1")
_COUNTS, _METRES = ("16UC1", "mono16", "z16"), ("32FC1",)
MILLIMETRE = 0.001
"""Metres per count of 16 bit depth, by ROS's REP 118."""
_PACKED_DEPTH = 12
"""Bytes of ROS's `compressedDepth` before its PNG."""


def pixels(message: Any, topic: str) -> np.ndarray:
    """The picture (H, W, 3) uint8 sRGB of a `sensor_msgs/Image` or `sensor_msgs/CompressedImage`.

    Raises:
        ArtifactError: It is damaged, or of an encoding that is no 8-bit colour.
    """
    if not hasattr(message, "encoding"):
        return np.asarray(_decoded(bytes(message.data), topic, "RGB"))
    if message.encoding in _GREY:
        return np.repeat(_rows(message, topic, 1)[..., :1], 3, axis=2)
    if message.encoding not in _ENCODINGS:
        raise unreadable(topic, "a picture", f"`{message.encoding}` is not one of mono8, {', '.join(_ENCODINGS)}")
    size, order = _ENCODINGS[message.encoding]
    return np.ascontiguousarray(_rows(message, topic, size)[..., order])


def depths(message: Any, topic: str, scale_m: float = MILLIMETRE) -> np.ndarray:
    """The depth (H, W) float32 [m] of an image message; 0 where nothing was measured.

    Args:
        message: 16 bit counts, 32 bit metres, or ROS's `compressedDepth` of counts.
        topic: Its topic, for errors.
        scale_m: Metres per count.

    Raises:
        ArtifactError: It is damaged, or of an encoding that is no depth.
    """
    if not hasattr(message, "encoding"):
        data = bytes(message.data)
        start = _PACKED_DEPTH if "compressedDepth" in str(message.format) and not data.startswith(b"\x89PNG") else 0
        return _metres(_decoded(data[start:], topic, None), topic, scale_m)
    order = ">" if getattr(message, "is_bigendian", 0) else "<"
    if message.encoding in _COUNTS:
        counts = np.ascontiguousarray(_rows(message, topic, 2)).view(f"{order}u2")[..., 0]
        return _metres(counts, topic, scale_m)
    if message.encoding in _METRES:
        found = np.ascontiguousarray(_rows(message, topic, 4)).view(f"{order}f4")[..., 0]
        return np.nan_to_num(found.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    raise unreadable(topic, "depth", f"`{message.encoding}` is not one of {', '.join(_COUNTS + _METRES)}")


def _metres(counts: np.ndarray, topic: str, scale_m: float) -> np.ndarray:
    if counts.ndim != 2 or counts.dtype.kind not in "uib":
        raise unreadable(topic, "depth", "its pixels are not single whole numbers")
    return np.where(counts == 65535, 0.0, counts * scale_m).astype(np.float32)


def _decoded(data: bytes, topic: str, mode: str | None) -> np.ndarray:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG")) as picture:
            return np.array(picture.convert(mode) if mode else picture)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise unreadable(topic, "PNG or JPEG", error) from None


def _rows(message: Any, topic: str, size: int) -> np.ndarray:
    """(H, W, bytes per pixel) of an uncompressed image."""
    data = np.frombuffer(bytes(message.data), np.uint8)
    used, step = message.width * size, message.step
    if step < used or len(data) < message.height * step:
        raise unreadable(topic, "a picture", f"{len(data):,} bytes are not {message.height} rows of {step}")
    return data[: message.height * step].reshape(message.height, -1)[:, :used].reshape(message.height, -1, size)
