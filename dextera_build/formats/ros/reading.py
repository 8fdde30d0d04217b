"""Messages of MCAP files by topic and time, decoded by the schemas in the file."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.errors import ArtifactError
from dextera_build.formats.ros import chunks, foxglove, pose_arrays

SECOND = 1_000_000_000


@dataclass(frozen=True, order=True)
class Found:
    """A channel of a file.

    Args:
        topic: `/joint_states`.
        kind: Name of its messages' type, `sensor_msgs/msg/JointState`.
        encoding: Encoding of its messages: `cdr`.
        count: Number of messages.
    """

    topic: str
    kind: str
    encoding: str
    count: int


@contextmanager
def damage(name: str) -> Iterator[None]:
    """Convert exceptions of readers on damaged files to one error that names the file."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    try:
        yield
    except (McapError, ZstdError, RuntimeError, ValueError, struct.error, EOFError, LookupError) as error:
        raise unreadable(name, "MCAP", str(error) or type(error).__name__) from None


def index(stream: IO[bytes], name: str) -> tuple[list[Found], int, int]:
    """Channels by topic, and the times of the first and the last message [ns], from the index at the end of a file.

    Raises:
        ArtifactError: It is no MCAP file, has no index, or its chunks are too large.
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
    with damage(name):
        chunks.check(stream, name, summary.chunk_indexes)
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
    stream: IO[bytes],
    name: str,
    topics: Sequence[str],
    start: int | None = None,
    end: int | None = None,
    *,
    as_written: bool = False,
) -> Iterator[tuple[int, str, Any]]:
    """(time of the recording [ns], topic, decoded message) in order of time; only chunks of the interval are read.

    Args:
        stream: The file.
        name: Its name, for errors.
        topics: Topics to read.
        start: First time [ns]; None: from the beginning.
        end: End of the interval, exclusive [ns]; None: to the end.
        as_written: Keep the order of the file, which shows a clock that was set back.

    Raises:
        ArtifactError: The file is damaged, or the type of a message is unknown.
    """
    from mcap.reader import SeekingReader
    from mcap_ros2.decoder import DecoderFactory

    factories = [pose_arrays.Decoders(), DecoderFactory(), foxglove.Decoders()]
    reader = SeekingReader(stream, decoder_factories=factories)  # type: ignore[arg-type]
    with damage(name):
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            topics=list(topics), starting_at=start, ending_before=end, log_time_order=not as_written
        ):
            yield message.log_time, channel.topic, foxglove.shaped(schema.name if schema else "", decoded)


def stamp(message: Any, received: int) -> int:
    """Time of a message's header [ns], or of the recording if there is no header."""
    header = getattr(message, "header", None)
    found = 0 if header is None else header.stamp.sec * SECOND + header.stamp.nanosec
    return int(found or received)
