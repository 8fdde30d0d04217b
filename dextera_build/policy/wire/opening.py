"""Opens a link to a policy, with the protocol that its address names."""

from __future__ import annotations

from dextera_build.policy.wire.link import Link
from dextera_build.policy.wire.posted import Posted
from dextera_build.policy.wire.websocket import WebSocket

POSTED = ("http://", "https://")
SCHEMES = ("ws://", "wss://", *POSTED)


def opened(address: str, key: str = "") -> Link:
    """A link to the policy at an address.

    Args:
        address: `ws://127.0.0.1:8000` of openpi's protocol, or `http://127.0.0.1:8000/act` of OpenVLA's.
        key: Sent as `Authorization: Api-Key`; empty: none.

    Raises:
        MachineError: Nothing answers there, or it refuses this client.
    """
    return Posted(address, key) if address.startswith(POSTED) else WebSocket(address, key)
