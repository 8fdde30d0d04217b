"""Elements and boxes exactly as listed in a `scene.yaml`; no proposals, no measurements."""

from __future__ import annotations

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace

BACKEND = Backend(summary="only the elements of `scene.yaml`, with their boxes")


def propose(ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: Options) -> None:
    """None: the boxes of `scene.yaml` are used as they are."""
