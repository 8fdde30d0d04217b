"""evaluate.views: render a room in other posed views of it, and compare (paper, Table III)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera, Measured, Photograph
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.table import Table
from dextera_build.geometry import metrics
from dextera_build.rule import Context, Options, rule

from . import fidelity, other_view
from .posed import PosedView, PosedViews

OWN, SEEN, STATIC, ALL = "capture's camera, outside objects", "seen by the capture", "seen, outside objects", "all"
Drawn = tuple[np.ndarray, np.ndarray]
"""Rendered colours (H, W, 3) uint8 and depth (H, W) [m], 0 without a surface."""


class ViewsOptions(Options):
    """Options of evaluate.views."""

    seen_m: PositiveFloat = 0.05
    """Maximum depth difference of a pixel's surface that is visible in the capture [m]."""
    objects_px: NonNegativeInt = 8
    """Dilation of objects before they are excluded [px]."""
    only_drawn: bool = False
    """Whether only pixels with a rendered surface are compared, because a splat leaves gaps between its points."""


class ViewsBackend(Protocol):
    """Interface of a backend of evaluate.views."""

    def draw(
        self,
        ctx: Context,
        scene: Scene,
        room: Room | None,
        own: other_view.Own,
        camera: Camera,
        moves: np.ndarray,
        options: Any,
    ) -> Iterator[Drawn]:
        """Colours and depth of the room, or of the capture's measurements, from cameras `moves` (N, 4, 4).

        `moves` are T_own_other, in the frame of the camera of the capture `own`.
        """
        ...


@rule(version=2, packages=("numpy", "scipy", "pillow"))
def views(
    ctx: Context[ViewsBackend],
    scene: Scene,
    photograph: Photograph,
    measured: Measured,
    instances: InstanceMap,
    views: Folder,
    room: Room | None = None,
    *,
    options: ViewsOptions | None = None,
) -> Table:
    """Return scores in the capture's own view, outside objects, and means over all other views.

    Poses of `views.json` are relative; the twin is placed by the view whose `frame` is that of `capture.json`.
    """
    options = options or ViewsOptions()
    given = PosedViews(ctx, views)
    size = photograph.rgb.pixels.shape[:2]
    if size != (given.camera.height, given.camera.width):
        ctx.fail("the views are not of the photograph's size", views=given.camera, photograph=f"{size}")
    things = (instances.labels > 0) | given.objects()
    own = other_view.Own(photograph.rgb.pixels, measured.depth.depth, things, given.camera.matrix())
    frames = [given.own, *(frame for frame in sorted(given.poses) if frame != given.own)]
    moves = np.stack([np.linalg.inv(given.poses[given.own]) @ given.poses[frame] for frame in frames])
    scores: dict[str, list[fidelity.Score]] = {OWN: [], SEEN: [], STATIC: [], ALL: []}
    share, strips = [], []
    drawn = ctx.backend.draw(ctx, scene, room, own, given.camera, moves, ctx.backend_options)
    for number, (frame, move, picture) in enumerate(zip(frames, moves, drawn, strict=True)):
        view = given.view(frame)
        bare = ~other_view.objects(own, view.depth, move, options.objects_px)
        if frame == given.own:
            bare &= ~other_view.dilated(own.objects, options.objects_px)
            scores[OWN].append(_score(picture, view, own.k, bare, options.only_drawn))
        else:
            seen = other_view.seen(own, view.depth, move, options.seen_m)
            scores[SEEN].append(_score(picture, view, own.k, seen, options.only_drawn))
            scores[STATIC].append(_score(picture, view, own.k, seen & bare, options.only_drawn))
            scores[ALL].append(_score(picture, view, own.k, np.ones_like(seen), False))
            share.append(float(seen.mean()))
            strips.append(_strip(view.rgb, picture[0]))
        ctx.progress(number + 1, len(frames), "views")
    ctx.preview(np.hstack(strips[:: max(1, len(strips) // 8)]), "other views above, the room drawn into them below")
    return _table(ctx, scores, share, options)


def _strip(*pictures: np.ndarray) -> np.ndarray:
    step = max(1, len(pictures[0]) // 120)
    return np.vstack([picture[::step, ::step] for picture in pictures])


def _score(drawn: Drawn, view: PosedView, k: np.ndarray, where: np.ndarray, only_drawn: bool) -> fidelity.Score:
    counted = where & (drawn[1] > 0) if only_drawn else where
    found = fidelity.score(*drawn, view.rgb, view.depth, k, counted)
    coverage = float((drawn[1][where] > 0).mean()) if where.any() else None
    return (*found[:-1], coverage)


def _table(ctx: Context, scores: dict[str, list[fidelity.Score]], share: list[float], options: ViewsOptions) -> Table:
    means = {area: fidelity.mean(found) for area, found in scores.items()}
    column = {c.name: number for number, c in enumerate(fidelity.COLUMNS[1:])}
    reported = {
        "PSNR, all": (means[ALL][column["PSNR"]], "dB"),
        "PSNR, seen": (means[SEEN][column["PSNR"]], "dB"),
        "Depth MAE, seen": (means[SEEN][column["Depth MAE"]], "m"),
        "Depth median, seen": (means[SEEN][column["Depth median"]], "m"),
        "Coverage": (means[ALL][column["Coverage"]], ""),
    }
    for name, (value, unit) in reported.items():
        if isinstance(value, float):
            ctx.metric(name, value, unit)
    said = (f"{name} {value:.3g} {unit}".rstrip() for name, (value, unit) in reported.items() if value is not None)
    ctx.say(", ".join(said))
    return Table(
        title="A room in other views of it",
        columns=fidelity.COLUMNS,
        rows=tuple((area, *mean) for area, mean in means.items()),
        notes=(
            f"means over {len(share)} views that nothing but this table has read; the capture saw "
            f"{metrics.mean_std(share)[0] or 0:.0%} of their pixels",
            f"seen: pixels whose measured surface is within {1000 * options.seen_m:g} mm of the capture's depth",
            "objects: pixels of the capture's instances, and of true things where the views name them, carried over by "
            f"depth and dilated by {options.objects_px} px",
            *fidelity.DEFINITIONS,
        ),
    )
