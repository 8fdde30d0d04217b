"""learn.served without a network: the contract that options and task give."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.policy.wire.said import NOTHING, Said
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .served_options import ServedOptions

BACKEND = Backend(summary="no server: nothing is asked", profiles=("stub",))


def asked(ctx: Context, common: ServedOptions, options: Options) -> Said:
    """Nothing."""
    return NOTHING
