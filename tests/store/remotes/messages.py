"""Every message that dxb writes or reads, as Hypothesis makes them, and what they hold by field number."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from typing import Any, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

from dextera_build.store import wire
from dextera_build.store.remotes import execution, protocol
from dextera_build.store.remotes.remote import Digest

CLASSES: list[type] = [
    Digest,
    *(
        kind
        for module in (protocol, execution)
        for kind in vars(module).values()
        if dataclasses.is_dataclass(kind) and isinstance(kind, type)
    ),
]
"""All of them."""
THEIRS = {
    "UpdateCapabilities": "ActionCacheUpdateCapabilities",
    "Upload": "BatchUpdateBlobsRequest.Request",
    "Stored": "BatchUpdateBlobsResponse.Response",
    "Download": "BatchReadBlobsResponse.Response",
    "Tool": "ToolDetails",
}
"""Names of ours that are others in the published files."""
_AS_BYTES: defaultdict[type, list[tuple[str, type]]] = defaultdict(list)
"""Fields that hold a message which we hand on as it came."""
_AS_BYTES[protocol.UpdateActionResultRequest] = [("action_result", execution.ActionResult)]
_PLAIN = {
    str: st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    bytes: st.binary(max_size=300),
    int: st.integers(0, (1 << 31) - 1),
    bool: st.booleans(),
}


def numbered(kind: type) -> dict[int, tuple[str, type, bool]]:
    """Field number -> (name, type, whether there may be many)."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        inner, number = get_args(hint)
        many = get_origin(inner) is tuple
        found[number] = (name, get_args(inner)[0] if many else inner, many)
    return found


def messages(kind: type) -> st.SearchStrategy[Any]:
    """Messages of one class."""
    if kind in _PLAIN:
        return _PLAIN[kind]
    fields = {
        name: st.lists(messages(each), max_size=3).map(tuple) if many else messages(each)
        for name, each, many in numbered(kind).values()
    }
    return st.builds(kind, **fields | {name: messages(inner).map(wire.encode) for name, inner in _AS_BYTES[kind]})


def plain(message: Any) -> Any:
    """What a message holds as JSON: field number -> value, without those that hold nothing."""
    if isinstance(message, bytes):
        return message.hex()
    if isinstance(message, bool | int | str):
        return message
    found = {}
    for number, (name, _, many) in numbered(type(message)).items():
        value = getattr(message, name)
        for opaque, inner in _AS_BYTES[type(message)]:
            value = wire.decode(inner, value) if name == opaque else value
        body = [plain(one) for one in value] if many else plain(value)
        if body:
            found[str(number)] = body
    return found
