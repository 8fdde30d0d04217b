"""MCAP files of ROS 2 messages (https://mcap.dev/spec and its registry: profile `ros2`)."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Literal, Self

import numpy as np

from dextera_build.errors import UsageError
from dextera_build.formats.ros import types

_FOREVER = "{sec: 9223372036, nsec: 854775807}"
LATCHED = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, avoid_ros_namespace_conventions: false, "
    f"deadline: {_FOREVER}, lifespan: {_FOREVER}, liveliness_lease_duration: {_FOREVER}}}"
)
"""Quality of service of one-time messages: reliable and transient local, for late subscribers."""


def check_new(path: Path) -> None:
    """Check that a recording can be written; its folder is made.

    Raises:
        UsageError: It does not end in `.mcap`, it exists, or its folder cannot be written.
    """
    if path.suffix != ".mcap":
        raise UsageError(f"`{path}` does not end in .mcap", code="DXB-U335", hint="`--out recordings/mine.mcap`")
    if path.exists():
        raise UsageError(
            f"`{path}` exists",
            code="DXB-U330",
            hint=f"`--out {path.with_stem(path.stem + '_2')}`, or move it away",
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise UsageError(
            f"recordings cannot be written to `{path.parent}`",
            code="DXB-U349",
            facts={"system": error.strerror or str(error)},
            hint="name another folder by `--out FOLDER/NAME.mcap`",
        ) from None


class Recording:
    """An MCAP file that is being written; channels are created with their first message.

    Args:
        out: Output stream.
        compression: Compression of the file's chunks.
        chunk_bytes: Size at which a chunk is written.
    """

    def __init__(
        self, out: IO[bytes], compression: Literal["zstd", "none"] = "zstd", chunk_bytes: int = 1 << 20
    ) -> None:
        from mcap.writer import CompressionType, Writer

        packed = CompressionType.ZSTD if compression == "zstd" else CompressionType.NONE
        self._writer = Writer(out, chunk_size=chunk_bytes, compression=packed)
        self._writer.start(profile="ros2", library="dextera-build")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def __enter__(self) -> Self:
        """The recording itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Write the index, which readers need."""
        self.finish()

    def finish(self) -> None:
        """Write the index and end the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def metadata(self, name: str, facts: Mapping[str, str]) -> None:
        """Write texts by name."""
        self._writer.add_metadata(name, dict(facts))

    def attach(self, name: str, value: object) -> None:
        """Write an attachment of plain data as JSON."""
        data = (json.dumps(value, indent=1, sort_keys=True) + "\n").encode()
        self._writer.add_attachment(0, 0, name, "application/json", data)

    def attach_files(self, files: Mapping[str, bytes]) -> None:
        """Write attachments by name."""
        for name, data in files.items():
            kind = {"urdf": "application/xml", "stl": "model/stl"}.get(name.rpartition(".")[2], "")
            self._writer.add_attachment(0, 0, name, kind or "application/octet-stream", data)

    def send(self, topic: str, kind: str, time: int, message: bytes, quality: str = "") -> None:
        """Write a message.

        Args:
            topic: `/joint_states`.
            kind: Its type, `sensor_msgs/JointState`.
            time: Time of the recording [ns].
            message: Its CDR bytes.
            quality: Offered quality of service, as YAML.
        """
        if kind not in self._schemas:
            name = types.full_name(kind)
            self._schemas[kind] = self._writer.register_schema(name, "ros2msg", types.schema(kind))
        if topic not in self._channels:
            about = {"offered_qos_profiles": quality}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind], about)
        self._writer.add_message(self._channels[topic], log_time=time, publish_time=time, data=message)


def packed(pixels: np.ndarray, form: Literal["png", "jpeg"], quality: int = 92) -> bytes:
    """Encode a frame (H, W, 3) uint8 sRGB as PNG or as JPEG of a quality from 1 to 100."""
    from PIL import Image

    buffer = io.BytesIO()
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    if form == "png":
        picture.save(buffer, format="PNG", compress_level=3)
    else:
        picture.save(buffer, format="JPEG", quality=quality, subsampling=0)
    return buffer.getvalue()
