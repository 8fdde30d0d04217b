"""Backend geometry of align.canonical: stability, openings, handles and pictures on the sides."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.objects.canonical import Open
from dextera_build.geometry import canonical as geometry
from dextera_build.geometry import lie, metrics, symmetry
from dextera_build.rule import Backend, Context, Options

from .bodies import Surface
from .chosen import Chosen

BACKEND = Backend(
    summary="up by stable rest, openings and the photograph; front by handles and pictures",
    profiles=("cpu",),
    packages=("open3d", "scipy"),
    extra="twin",
)


class GeometryOptions(Options):
    """Options of backend `geometry` of align.canonical."""

    clear_up: PositiveFloat = geometry.CLEAR
    """Minimum margin of the best up direction over the next one."""
    clear_front: PositiveFloat = 1.0
    """Minimum margin of the best front over the next side, in units of the smallest significant handle or picture."""


def choose(ctx: Context, surface: Surface, seen_up: np.ndarray | None, options: GeometryOptions) -> Chosen:
    """The directions with the best scores; undecided if the next one is close."""
    samples = geometry.sample(surface.vertices, surface.faces, surface.paint)
    up_judged = geometry.ups(samples, surface.cast, seen_up)
    up = geometry.DIRECTIONS[int(np.argmax(up_judged.scores))]
    centre = metrics.surface_centroid(surface.vertices, surface.faces)

    def turned(angle: float) -> bool:
        moved = (samples.points[:300] - centre) @ lie.rotation(up * angle).T + centre
        return bool(np.quantile(surface.distances(moved), 0.98) < symmetry.ALIKE * samples.size)

    sides, front_judged = geometry.fronts(samples, up, turned)
    undecided: list[Open] = []
    if up_judged.lead < options.clear_up:
        undecided.append("up")
    if front_judged.lead < options.clear_front:
        undecided.append("front")
    return Chosen(
        up,
        sides[int(np.argmax(front_judged.scores))],
        tuple(undecided),
        f"up: {up_judged.reason}, front: {front_judged.reason}",
        by_colour=front_judged.reason == "picture" and front_judged.lead >= options.clear_front,
        up_lead=up_judged.lead,
        front_lead=front_judged.lead,
    )
