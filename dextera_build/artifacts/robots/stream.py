"""Recordings of a robot and its cameras; `formats.mcap` reads their messages by topic and time."""

from __future__ import annotations

from pydantic import NonNegativeInt

from dextera_build.artifacts.base import Artifact, File, Value


class Channel(Value):
    """One topic of a recording."""

    topic: str
    """`/joint_states`."""
    kind: str
    """Type of its messages, `sensor_msgs/msg/JointState`."""
    encoding: str
    """Encoding of its messages; `cdr`, `protobuf` and `json` can be decoded."""
    count: NonNegativeInt
    """Number of messages."""


class Stream(Artifact):
    """A recording. Its index is in memory; messages stay in the file."""

    file: File
    """The MCAP file."""
    channels: tuple[Channel, ...]
    """Its index: the recorded channels."""
    start_ns: NonNegativeInt
    """Time of the first message [ns]."""
    end_ns: NonNegativeInt
    """Time of the last message [ns]."""

    def duration_s(self) -> float:
        """Time from the first to the last message [s]."""
        return (self.end_ns - self.start_ns) / 1e9
