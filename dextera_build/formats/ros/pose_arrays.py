"""`geometry_msgs/PoseArray` in CDR as one array: the general decoder makes three objects of every pose."""

from __future__ import annotations

import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

KIND = "geometry_msgs/msg/PoseArray"


class Decoders:
    """A decoder factory of `mcap.reader` for this one type."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        """The function that decodes a channel's messages; None for other types and encodings."""
        return decoded if message_encoding == "cdr" and schema is not None and schema.name == KIND else None


def decoded(data: bytes) -> Any:
    """A message with `header`, and `poses` (K, 7) float64 in the order of ROS: x y z, quaternion x y z w.

    Raises:
        ValueError: It is no such message.
    """
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
    frame = data[16 : 16 + length].rstrip(b"\0").decode()
    at = 16 + length + -length % 4
    (count,) = struct.unpack_from(f"{order}I", data, at)
    at = at + 4 + -at % 8  # numbers are aligned to 8 bytes behind the 4 bytes of the encapsulation
    poses = np.frombuffer(data, f"{order}f8", 7 * count, at).reshape(count, 7) if count else np.zeros((0, 7))
    stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=frame), poses=poses)
