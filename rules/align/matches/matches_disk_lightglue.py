"""Backend `disk_lightglue` of align.matches: DISK with LightGlue, in its own environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .matches import MatchesOptions

BACKEND = Backend(
    summary="DISK with LightGlue",
    command=("{python}", "disk_lightglue_program.py"),
    environment="venv:.envs/disk_lightglue",
    lock="envs/disk_lightglue.lock",
    server=True,
    licence="Apache-2.0",
)


class DiskLightglueOptions(Options):
    """Options of backend `disk_lightglue` of align.matches."""

    least_confidence: float = Field(0.1, ge=0.0, le=1.0)
    """Minimum confidence of a pair."""


def match(ctx: Context, first: Image, second: Image, common: MatchesOptions, options: DiskLightglueOptions) -> Matches:
    """Points of DISK (Tyszkiewicz et al., 2020), paired by LightGlue (Lindenberger et al., 2023)."""
    return ctx.outside("match", Matches, first=first, second=second, points=common.points)
