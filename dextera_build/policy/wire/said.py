"""What the server of a policy says when a program connects."""

from __future__ import annotations

import os
from typing import NamedTuple

from dextera_build import digest
from dextera_build.errors import MachineError
from dextera_build.policy.wire import link, promise
from dextera_build.policy.wire.codec import MessageError, unpack
from dextera_build.policy.wire.opening import opened


class Said(NamedTuple):
    """What a server says of its policy."""

    digest: str
    """Digest of its first message; empty if its protocol has none."""
    promise: promise.Promise | None
    """What `dxb serve` promises; None of another program."""


NOTHING = Said("", None)


def connected(address: str, key_in: str) -> tuple[link.Link, Said]:
    """A link to a policy, and what its server says.

    Args:
        address: Address of the server.
        key_in: Environment variable that holds its key; empty: it asks for none.

    Raises:
        MachineError: Nothing answers there, it refuses this client, or the variable is not set.
    """
    key = os.environ.get(key_in, "") if key_in else ""
    if key_in and not key:
        raise MachineError(
            f"the environment variable `{key_in}` is empty, which holds the key of the policy at `{address}`",
            code="DXB-E367",
            hint=f"export {key_in}=...; variables that begin with `DXB_` are kept from rules",
        )
    found = opened(address, key)
    if not found.greeting:
        return found, NOTHING
    try:
        said = promise.read(unpack(found.greeting))
    except MessageError as error:
        found.close()
        raise link.unreachable(address, f"its metadata are no message: {error}") from None
    return found, Said(digest.of_bytes(found.greeting), said)
