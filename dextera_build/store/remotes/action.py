"""The `Action` that stands for a key: servers read, check and show what lies under the digest of an action.

Its command is `dxb`, and the one file of its input root is the key document, so its digest follows from the key. The
key itself travels in the metadata of the call, so that a store that knows results by key finds this one, too.
"""

from __future__ import annotations

import hashlib
from typing import NamedTuple

from dextera_build.store import wire
from dextera_build.store.cas import is_digest
from dextera_build.store.remotes import execution
from dextera_build.store.remotes.protocol import EXECUTION
from dextera_build.store.remotes.remote import Digest

METADATA = f"{EXECUTION}.requestmetadata-bin"
"""Name of the header that says who asks, and for what action."""


class Standing(NamedTuple):
    """What stands for a key."""

    digest: Digest
    """Of the `Action`."""
    blobs: dict[Digest, bytes]
    """The `Action`, and the `Command` and `Directory` that it refers to."""


def of_key(key: Digest) -> Standing:
    """The action of a key, which is the digest of a key document."""
    command = wire.encode(execution.Command(("dxb",)))
    root = wire.encode(execution.Directory((execution.FileNode("key.json", key),)))
    action = wire.encode(execution.Action(of_bytes(command), of_bytes(root)))
    return Standing(of_bytes(action), {of_bytes(data): data for data in (command, root, action)})


def of_bytes(data: bytes) -> Digest:
    """What names these bytes."""
    return Digest(hashlib.sha256(data).hexdigest(), len(data))


def metadata(tool: execution.Tool, invocation: str, key: Digest | None = None) -> tuple[str, bytes]:
    """The header that says who asks, and for which key."""
    action = f"{key.hash}/{key.size}" if key else ""
    return METADATA, wire.encode(execution.RequestMetadata(tool, action, invocation))


def key_in(header: bytes, action: Digest) -> Digest | None:
    """The key that a client means by `action`, or None where it says nothing that leads there."""
    try:
        name, _, size = wire.decode(execution.RequestMetadata, header).action_id.partition("/")
    except ValueError:
        return None
    if not is_digest(name) or not size.isdecimal() or len(size) > 18:
        return None
    key = Digest(name, int(size))
    return key if of_key(key).digest == action else None
