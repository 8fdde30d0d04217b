"""Messages of MCAP files by topic and time, decoded by the schemas that the file itself holds."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from dextera_build.artifacts.formats import unreadable
from dextera_build.errors import ArtifactError

SECOND = 1_000_000_000
_SATURATED = 65535
"""Counts of depth that many drivers write for missing returns."""
_ENCODINGS = {"rgb8": (3, [0, 1, 2]), "bgr8": (3, [2, 1, 0]), "rgba8": (4, [0, 1, 2]), "bgra8": (4, [2, 1, 0])}
"""Encoding of `sensor_msgs/Image` -> bytes per pixel, and where red, green and blue are among them."""


@dataclass(frozen=True, order=True)
class Found:
    """A channel of a file.

    Args:
        topic: `/joint_states`.
        kind: Name of its messages' type, `sensor_msgs/msg/JointState`.
        encoding: Of its messages: `cdr`.
        count: Number of messages.
    """

    topic: str
    kind: str
    encoding: str
    count: int


@contextmanager
def damage(name: str) -> Iterator[None]:
    """Turn what readers raise on damaged files into one error that names the file."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    try:
        yield
    except (McapError, ZstdError, RuntimeError, ValueError, struct.error, EOFError, LookupError) as error:
        raise unreadable(name, "MCAP", str(error) or type(error).__name__) from None


def index(stream: IO[bytes], name: str) -> tuple[list[Found], int, int]:
    """Channels by topic, and the times of the first and the last message [ns], from the index at the end of a file.

    Raises:
        ArtifactError: It is no MCAP file, or has no index.
    """
    from mcap.reader import SeekingReader

    with damage(name):
        summary = SeekingReader(stream).get_summary()
    if summary is None or summary.statistics is None:
        raise ArtifactError(
            f"`{Path(name).name}` has no index, so it was not finished or is cut short",
            code="DXB-A516",
            hint="`mcap recover FILE -o FIXED`",
        )
    statistics, kinds = summary.statistics, {key: schema.name for key, schema in summary.schemas.items()}
    found = [
        Found(
            channel.topic,
            kinds.get(channel.schema_id, ""),
            channel.message_encoding,
            statistics.channel_message_counts.get(key, 0),
        )
        for key, channel in summary.channels.items()
    ]
    return sorted(found), statistics.message_start_time, statistics.message_end_time


def messages(
    stream: IO[bytes], name: str, topics: Sequence[str], start: int | None, end: int | None
) -> Iterator[tuple[int, str, Any]]:
    """(time of the recording [ns], topic, decoded message) in order of time; only chunks of that time are read.

    Args:
        stream: The file.
        name: Its name, for errors.
        topics: Topics to read.
        start: First time [ns]; None: from the beginning.
        end: First time that is left out [ns]; None: to the end.

    Raises:
        ArtifactError: The file is damaged, or the type of a message is unknown.
    """
    from mcap.reader import SeekingReader
    from mcap_ros2.decoder import DecoderFactory

    reader = SeekingReader(stream, decoder_factories=[DecoderFactory()])
    with damage(name):
        for _, channel, message, decoded in reader.iter_decoded_messages(
            topics=list(topics), starting_at=start, ending_before=end
        ):
            yield message.log_time, channel.topic, decoded


def stamp(message: Any, received: int) -> int:
    """Time of a message's header [ns]; the time of the recording where the header has none."""
    header = getattr(message, "header", None)
    found = 0 if header is None else header.stamp.sec * SECOND + header.stamp.nanosec
    return int(found or received)


def pixels(message: Any, topic: str) -> np.ndarray:
    """The picture (H, W, 3) uint8 sRGB of a `sensor_msgs/Image` or `sensor_msgs/CompressedImage`.

    Raises:
        ArtifactError: It is damaged, or of an encoding that is no 8-bit colour.
    """
    if not hasattr(message, "encoding"):
        from PIL import Image

        try:
            with Image.open(io.BytesIO(bytes(message.data)), formats=("PNG", "JPEG")) as picture:
                return np.asarray(picture.convert("RGB"))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise unreadable(topic, "PNG or JPEG", error) from None
    if message.encoding == "mono8":
        return np.repeat(_rows(message, topic, 1)[..., :1], 3, axis=2)
    if message.encoding not in _ENCODINGS:
        raise unreadable(topic, "a picture", f"`{message.encoding}` is not one of mono8, {', '.join(_ENCODINGS)}")
    size, order = _ENCODINGS[message.encoding]
    return np.ascontiguousarray(_rows(message, topic, size)[..., order])


def depth(message: Any, topic: str) -> np.ndarray:
    """Depth (H, W) float32 [m], 0 where nothing was measured, of a `sensor_msgs/Image` as REP 118 defines it.

    `16UC1` and `mono16` count millimetres, `32FC1` are metres with NaN or infinity where nothing was measured.

    Raises:
        ArtifactError: It is damaged, or of another encoding.
    """
    kind = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}.get(str(message.encoding))
    if kind is None:
        raise unreadable(topic, "a depth picture", f"`{message.encoding}` is not one of 16UC1, mono16, 32FC1")
    size = 2 if kind == "u2" else 4
    data, used = np.frombuffer(bytes(message.data), np.uint8), message.width * size
    if message.step < used or len(data) < message.height * message.step:
        raise unreadable(topic, "a depth picture", f"{len(data):,} bytes are not {message.height} rows")
    rows = np.ascontiguousarray(data[: message.height * message.step].reshape(message.height, -1)[:, :used])
    values = rows.view(f"{'>' if message.is_bigendian else '<'}{kind}").astype(np.float32)
    if size == 2:
        return np.where(values < _SATURATED, values * np.float32(0.001), 0).astype(np.float32)
    return np.where(np.isfinite(values) & (values > 0), values, 0).astype(np.float32)


def _rows(message: Any, topic: str, size: int) -> np.ndarray:
    data = np.frombuffer(bytes(message.data), np.uint8)
    used = message.width * size
    if message.step < used or len(data) < message.height * message.step:
        raise unreadable(topic, "a picture", f"{len(data):,} bytes are not {message.height} rows of {message.step}")
    return data[: message.height * message.step].reshape(message.height, -1)[:, :used].reshape(message.height, -1, size)
