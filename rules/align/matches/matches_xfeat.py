"""Backend `xfeat` of align.matches: XFeat with mutual nearest neighbours, in its own environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .matches import MatchesOptions

BACKEND = Backend(
    summary="XFeat with mutual nearest neighbours",
    command=("{python}", "xfeat_program.py"),
    environment="venv:.envs/xfeat",
    lock="envs/xfeat.lock",
    server=True,
    licence="Apache-2.0",
)


class XfeatOptions(Options):
    """Options of backend `xfeat` of align.matches."""

    similarity: float = Field(0.82, gt=0.0, le=1.0)
    """Minimum cosine between two descriptors."""


def match(ctx: Context, first: Image, second: Image, common: MatchesOptions, options: XfeatOptions) -> Matches:
    """Pairs of XFeat (Potje et al., 2024); confidence is the cosine of the descriptors."""
    return ctx.outside("match", Matches, first=first, second=second, points=common.points)
