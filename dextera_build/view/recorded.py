"""What a recording of viser holds: its nodes, how they move, and what is hidden."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position (3,) [m] and quaternion w, x, y, z of a node in its parent."""
_STILL: Pose = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@dataclass
class Node:
    """A node of the scene."""

    kind: str
    """Type of viser's message, `MeshMessage`."""
    props: dict[str, Any]
    """Properties at the end; arrays are flat."""
    poses: dict[float, Pose] = field(default_factory=dict)
    """Time [s] -> pose from then on; 0 is among them."""
    visible: bool = True


def nodes(data: bytes) -> dict[str, Node]:
    """The nodes by name, `/task/box`, parents first, without those that are hidden at the end.

    Args:
        data: A recording, `.viser`.
    """
    found: dict[str, Node] = {}
    for seconds, message in _messages(data):
        kind, name = message["type"], message.get("name", "")
        if "props" in message:
            found[name] = Node(kind, message["props"], {0.0: _STILL})
        elif kind == "RemoveSceneNodeMessage":
            found.pop(name, None)
        elif name in found:
            _apply(found[name], seconds, kind, message)
    return {name: node for name, node in sorted(found.items()) if _seen(found, name)}


def _apply(node: Node, seconds: float, kind: str, message: Mapping[str, Any]) -> None:
    position, turn = next(reversed(node.poses.values()))
    if kind == "SetPositionMessage":
        node.poses[seconds] = tuple(message["position"]), turn
    elif kind == "SetOrientationMessage":
        node.poses[seconds] = position, tuple(message["wxyz"])
    elif kind == "SetSceneNodeVisibilityMessage":
        node.visible = message["visible"]
    elif kind == "SceneNodeUpdateMessage":
        node.props.update(message["updates"])


def _seen(found: Mapping[str, Node], name: str) -> bool:
    """Whether neither the node nor one of its parents is hidden."""
    parts = name.split("/")
    parents = ("/".join(parts[:count]) for count in range(2, len(parts) + 1))
    return all(found[parent].visible for parent in parents if parent in found)


def _messages(data: bytes) -> Iterator[tuple[float, dict[str, Any]]]:
    """Time [s] and message of every entry, with its arrays."""
    import msgspec
    import zstandard

    # 8 bytes with the size of what follows, which is compressed: 8 with the length of the messages, these, and arrays,
    # each at a multiple of 8.
    inner = zstandard.ZstdDecompressor().decompress(data[8:], max_output_size=int.from_bytes(data[:8], "little"))
    end = 8 + int.from_bytes(inner[:8], "little")
    held = msgspec.msgpack.decode(inner[8:end])
    buffers = []
    for length in held["binaryBufferLengths"]:
        start = -(-end // 8) * 8
        end = start + length
        buffers.append(inner[start:end])
    for seconds, message in held["messages"]:
        yield seconds, _filled(message, buffers)


def _filled(value: Any, buffers: list[bytes]) -> Any:
    """A part of a message with arrays (N,) in the place of references to them."""
    if isinstance(value, dict):
        if "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
        return {name: _filled(part, buffers) for name, part in value.items()}
    return [_filled(part, buffers) for part in value] if isinstance(value, list) else value
