"""learn.openpi without training: no weights, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

from .trained import Trained, untrained

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .openpi_options import OpenpiOptions

BACKEND = Backend(summary="no training: no weights", profiles=("stub",))


def train(ctx: Context, data: Folder, camera: str, joints: int, common: OpenpiOptions, options: Options) -> Trained:
    """A curve that falls."""
    return untrained(common.steps, version="0", base="0" * 64)
