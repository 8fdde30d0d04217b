"""Backend deaot of align.follow: DeAOT as in Segment-and-Track-Anything, in its own environment."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.video import Video
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(
    summary="DeAOT, from the masks of the first frame",
    command=("{python}", "deaot_program.py"),
    environment="venv:.envs/deaot",
    lock="envs/deaot.lock",
    gpu_gb=6.0,
    timeout_s=3600.0,
    licence="AGPL-3.0 (Segment-and-Track-Anything); BSD-3-Clause (AOT)",
)


class DeaotOptions(Options):
    """Options of backend `deaot` of align.follow."""

    memory_every: PositiveInt = 5
    """Interval between frames that are added to the memory, `long_term_mem_gap` of DeAOT."""


def follow(ctx: Context, video: Video, first: np.ndarray, names: tuple[str, ...], options: DeaotOptions) -> MaskTrack:
    """Masks of DeAOT (Yang and Yang 2022), given those of the first frame; without confidence scores."""
    return ctx.outside("follow", MaskTrack, video=video, first=first, names=list(names))
