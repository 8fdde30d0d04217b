"""learn.served over the network: connects once, and reads what the server says."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.policy.wire.said import Said, connected
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .served_options import ServedOptions

BACKEND = Backend(
    summary="web sockets as openpi's, or HTTP as OpenVLA's",
    profiles=("cpu",),
    packages=("websockets", "msgspec", "httpx"),
    extra="serve",
)


def asked(ctx: Context, common: ServedOptions, options: Options) -> Said:
    """What the server at the address says."""
    link, said = connected(common.address, common.key_in)
    link.close()
    return said
