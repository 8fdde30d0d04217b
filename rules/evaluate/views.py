"""evaluate.views: draw a twin into other posed views of its room, and compare (paper, Table III)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera, Measured, Photograph
from dextera_build.artifacts.scene import Scene
from dextera_build.artifacts.table import Table
from dextera_build.artifacts.view import InstanceMap
from dextera_build.geometry import metrics, raycast
from dextera_build.rule import Context, Options, rule

from . import elsewhere, fidelity
from .posed import PosedView, PosedViews

TWIN, SPLAT, SHEET = "twin", "baseline: depth splat", "baseline: one-sheet mesh"
ALL, SEEN, STATIC = "all", "seen by the capture", "seen, outside objects"
Drawn = tuple[np.ndarray, np.ndarray]
"""Colours (H, W, 3) uint8 and depth (H, W) [m], 0 without a surface."""


class ViewsOptions(Options):
    """Options of evaluate.views."""

    seen_m: PositiveFloat = 0.05
    """The capture saw a pixel if both depths of its surface differ by less [m]."""
    objects_px: NonNegativeInt = 8
    """Dilation of objects before they are excluded [px]."""


class ViewsBackend(Protocol):
    """What a backend of evaluate.views defines."""

    def draw(self, ctx: Context, scene: Scene, camera: Camera, poses: np.ndarray, options: Any) -> Iterator[Drawn]:
        """Colours and depth of the scene's home keyframe from each of `poses` (N, 4, 4), T_world_camera."""
        ...


@rule(version=1, packages=("numpy", "scipy", "open3d", "pillow"))
def views(
    ctx: Context[ViewsBackend],
    scene: Scene,
    photograph: Photograph,
    measured: Measured,
    instances: InstanceMap,
    views: Folder,
    *,
    options: ViewsOptions | None = None,
) -> Table:
    """Return means over all views but the capture's own: the twin, a depth splat, a one-sheet mesh, the paper's row.

    Poses of `views.json` are relative; the twin is placed by the view whose `frame` is that of `capture.json`.
    """
    options = options or ViewsOptions()
    given = PosedViews(ctx, views)
    own = elsewhere.Own(photograph.rgb.pixels, measured.depth.depth, instances.labels > 0, given.camera.matrix())
    if own.rgb.shape[:2] != (given.camera.height, given.camera.width):
        ctx.fail("the views are not of the photograph's size", views=given.camera, photograph=f"{own.rgb.shape[:2]}")
    room_from_own = given.poses[given.own]
    frames = [frame for frame in sorted(given.poses) if frame != given.own]
    moves = [np.linalg.inv(room_from_own) @ given.poses[frame] for frame in frames]
    world = np.stack([scene.camera_pose.matrix @ move for move in moves])
    twin = ctx.backend.draw(ctx, scene, given.camera, world, ctx.backend_options)
    surface = elsewhere.sheet(own)
    scores: dict[tuple[str, str], list[fidelity.Score]] = {}
    share: list[float] = []
    strips: list[np.ndarray] = []
    for number, (view, move, picture) in enumerate(zip(given.others(), moves, twin, strict=True)):
        seen = elsewhere.seen(own, view.depth, move, options.seen_m)
        bare = seen & ~elsewhere.objects(own, view.depth, move, options.objects_px)
        areas = {ALL: np.ones_like(seen), SEEN: seen, STATIC: bare}
        splat = elsewhere.splat(own, np.linalg.inv(move))
        for name, drawn in ((TWIN, picture), (SPLAT, splat), (SHEET, _sheet(surface, own, move))):
            for area, where in areas.items():
                # A splat leaves gaps between its points: only where it drew something is it compared.
                counted = where & (drawn[1] > 0) if name == SPLAT and area != ALL else where
                scores.setdefault((name, area), []).append(_score(drawn, view, own.k, counted, where))
        share.append(float(seen.mean()))
        strips.append(
            np.vstack([p[:: max(1, len(p) // 120), :: max(1, len(p) // 120)] for p in (view.rgb, picture[0])])
        )
        ctx.progress(number + 1, len(frames), "views")
    ctx.preview(np.hstack(strips[:: max(1, len(strips) // 8)]), "other views above, the twin drawn into them below")
    return _table(ctx, scores, share, options)


def _sheet(surface: raycast.Surface, own: elsewhere.Own, move: np.ndarray) -> Drawn:
    seen = raycast.render([surface], own.k, move, *own.depth.shape)
    return raycast.shade([surface], seen), seen.depth


def _score(drawn: Drawn, view: PosedView, k: np.ndarray, counted: np.ndarray, where: np.ndarray) -> fidelity.Score:
    found = fidelity.score(*drawn, view.rgb, view.depth, k, counted)
    coverage = float((drawn[1][where] > 0).mean()) if where.any() else None
    return (*found[:-1], coverage)


def _table(
    ctx: Context, scores: dict[tuple[str, str], list[fidelity.Score]], share: list[float], options: ViewsOptions
) -> Table:
    rows = [(name, area, *fidelity.mean(found)) for (name, area), found in scores.items()]
    column = {c.name: number for number, c in enumerate(fidelity.COLUMNS)}
    twin = {row[1]: row for row in rows if row[0] == TWIN}
    reported = {
        "PSNR, all": (twin[ALL][column["PSNR"]], "dB"),
        "PSNR, seen": (twin[SEEN][column["PSNR"]], "dB"),
        "Depth MAE, seen": (twin[SEEN][column["Depth MAE"]], "m"),
        "Depth median, seen": (twin[SEEN][column["Depth median"]], "m"),
        "Coverage": (twin[ALL][column["Coverage"]], ""),
    }
    for name, (value, unit) in reported.items():
        if isinstance(value, float):
            ctx.metric(name, value, unit)
    said = (f"{name} {value:.3g} {unit}".rstrip() for name, (value, unit) in reported.items() if value is not None)
    ctx.say(", ".join(said))
    return Table(
        title="The twin in other views of its room",
        columns=fidelity.COLUMNS,
        rows=(*rows, fidelity.PAPER),
        notes=(
            f"means over {len(share)} views that nothing but this table has read; the capture saw "
            f"{metrics.mean_std(share)[0] or 0:.0%} of their pixels: a pixel is seen if its measured surface is within "
            f"{1000 * options.seen_m:g} mm of the capture's depth",
            f"objects: pixels of the capture's instances, carried over by depth and dilated by {options.objects_px} px",
            "the depth splat is the capture's own depth, one pixel per point; where the capture saw, only pixels that "
            "it drew count. The one-sheet mesh joins all neighbouring pixels",
            "RGB MAE in sRGB 0..1, Delta E76 in float Lab (D65), SSIM with an 11 px Gaussian window; black where "
            "nothing is drawn",
            "centroid, Chamfer-L1 and F-score compare the points of both depth maps, "
            f"{fidelity.POINTS:,} per view, in the camera frame",
            "paper: DexTera, Table III: its own scenes from the camera that they were made from, another data set",
        ),
    )
