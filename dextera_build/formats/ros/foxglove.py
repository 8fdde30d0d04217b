"""Messages of Foxglove's schemas, as protobuf or JSON, converted to equivalent ROS messages.

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas. A `foxglove.JointStates` becomes a
    `sensor_msgs/JointState`, so that readers of recordings handle one form only.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from dextera_build.errors import ArtifactError, install_extra


class Decoders:
    """A decoder factory of `mcap.reader` for protobuf and JSON."""

    def __init__(self) -> None:
        self._protobuf: Any = None

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        """The function that decodes a channel's messages; None for other encodings."""
        if schema is None:
            return None
        if message_encoding == "json":
            return lambda data: _attributes(json.loads(data))
        if message_encoding != "protobuf":
            return None
        if self._protobuf is None:
            self._protobuf = _protobuf()
        return self._protobuf.decoder_for(message_encoding, schema)  # type: ignore[no-any-return]


def _protobuf() -> Any:
    try:
        from mcap_protobuf.decoder import DecoderFactory
    except ModuleNotFoundError:
        raise ArtifactError(
            "the recording holds protobuf messages, and nothing here decodes them",
            code="DXB-A529",
            hint=install_extra("recordings"),
        ) from None
    return DecoderFactory()


def shaped(kind: str, message: Any) -> Any:
    """A decoded message in the form of ROS; messages of ROS and of other schemas are unchanged.

    Args:
        kind: `foxglove.RawImage`, or `foxglove_msgs/msg/RawImage` in ROS recordings.
        message: Output of the decoder.
    """
    package, name = kind.replace("/msg/", ".").replace("/", ".").rpartition(".")[::2]
    if package not in ("foxglove", "foxglove_msgs"):
        return message
    shape = _SHAPES.get(name)
    return message if shape is None else shape(message, _header(message))


def _joints(message: Any, header: Any) -> Any:
    rows = list(message.joints)
    speeds = [each.velocity for each in rows if _stated(each, "velocity")]
    efforts = [each.effort for each in rows if _stated(each, "effort")]
    return SimpleNamespace(
        header=header,
        name=[each.name for each in rows],
        position=[each.position if _stated(each, "position") else float("nan") for each in rows],
        velocity=speeds if len(speeds) == len(rows) else [],
        effort=efforts if len(efforts) == len(rows) else [],
    )


def _picture(message: Any, header: Any) -> Any:
    found = {"header": header, "data": _bytes(message.data)}
    for name in ("format", "encoding", "width", "height", "step"):
        if hasattr(message, name):
            found[name] = getattr(message, name)
    return SimpleNamespace(**found)


def _lens(message: Any, header: Any) -> Any:
    return SimpleNamespace(
        header=header,
        height=message.height,
        width=message.width,
        distortion_model=message.distortion_model,
        d=list(getattr(message, "D", ())),
        k=list(getattr(message, "K", ())),
    )


def _pose(message: Any, header: Any) -> Any:
    return SimpleNamespace(header=header, pose=message.pose)


_SHAPES: Mapping[str, Callable[[Any, Any], Any]] = {
    "JointStates": _joints,
    "CompressedImage": _picture,
    "RawImage": _picture,
    "CameraCalibration": _lens,
    "PoseInFrame": _pose,
}


def _header(message: Any) -> Any:
    time = getattr(message, "timestamp", None)
    seconds = next((getattr(time, name) for name in ("seconds", "sec") if hasattr(time, name)), 0)
    rest = next((getattr(time, name) for name in ("nanos", "nanosec", "nsec") if hasattr(time, name)), 0)
    stamp = SimpleNamespace(sec=int(seconds), nanosec=int(rest))
    return SimpleNamespace(stamp=stamp, frame_id=getattr(message, "frame_id", ""))


def _stated(message: Any, name: str) -> bool:
    """Whether an optional number is present; protobuf has presence, JSON omits the field."""
    if hasattr(message, "HasField"):
        return bool(message.HasField(name))
    return getattr(message, name, None) is not None


def _bytes(data: Any) -> bytes:
    """Bytes, which are base64 in JSON."""
    return base64.b64decode(data) if isinstance(data, str) else bytes(data)


def _attributes(value: Any) -> Any:
    """JSON objects as attributes; `nsec` of ROS's JSON is `nanosec` here."""
    if isinstance(value, Mapping):
        found = {str(name): _attributes(each) for name, each in value.items()}
        if "sec" in found and "nsec" in found:
            found["nanosec"] = found["nsec"]
        return SimpleNamespace(**found)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_attributes(each) for each in value]
    return value
