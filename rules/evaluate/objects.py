"""evaluate.objects: compare a twin's bodies with the ground truth of a reference world (paper, Table II)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import metrics
from dextera_build.rule import ROUNDING, Context, Fraction, Options, Tolerance, rule

from .rendered_objects import Seen, counted, placed_bodies, render, true_objects

COLUMNS = (
    Column(name="Object"),
    Column(name="Asset"),
    Column(name="Visible", digits=2),
    Column(name="Mask IoU", better="higher"),
    Column(name="Boundary F1", better="higher"),
    Column(name="Boundary F1 2 px", better="higher"),
    Column(name="RGB MAE", better="lower"),
    Column(name="Delta E76", digits=2, better="lower"),
    Column(name="Depth MAE", unit="m", digits=4, better="lower"),
    Column(name="Centroid", unit="m", digits=4, better="lower"),
    Column(name="Chamfer-L1", unit="m", digits=4, better="lower"),
    Column(name="F-score@1cm", better="higher"),
)
MISSED: tuple[Cell, ...] = (0.0, None, None, None, None, None, None, None, None)
SPURIOUS = "-"
"""Name of the true object in the rows of assets that match none."""
PAPER: tuple[tuple[Cell, ...], ...] = (
    ("paper, Ours: mean", "86 instances, rgb", None, 0.731, 0.260, None, 0.182, 27.90, 0.0093, 0.0115, 0.0069, 0.906),
    ("paper, Ours: deviation", None, None, 0.136, 0.120, None, 0.062, 7.64, 0.0099, 0.0160, 0.0076, 0.132),
)


DEFINITIONS = (
    "RGB MAE (sRGB 0..1), Delta E76 (float Lab, D65) and depth MAE over the intersection of the masks; the twin is "
    "drawn with unlit textures, the truth is the faultless picture",
    "paper: DexTera, Table II, row Ours: mean and deviation over 86 instances of its own scenes, another data set than "
    "this one",
    "rgb: made from the photograph alone, as all assets of the paper are, which uses depth to align them; rgbd: made "
    "with the help of the photograph's depth",
)
"""Notes of every table with these columns."""


class ObjectsOptions(Options):
    """Options of evaluate.objects."""

    boundary_tolerance: PositiveFloat = 0.008
    """Tolerance of the boundary F1 in pixels; below 1, a fraction of the image diagonal."""
    match_iou: Fraction = 0.5
    """Minimum mask IoU at which an asset matches a true object."""
    least_visible: Fraction = 0.0
    """Minimum visible fraction of the outline of a true object that can be missed; less visible ones may be found."""
    whole: bool = False
    """Whether objects cut by the picture's border are left out, because parsing treats them as static."""
    summary: bool = True
    """Whether mean, deviation, count and the paper's row follow the objects."""
    samples: PositiveInt = 20000
    """Number of points per surface."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""
    threshold_m: PositiveFloat = 0.01
    """Distance threshold of the F-score [m]."""


@rule(version=2, packages=("numpy", "scipy", "open3d"), tolerance=Tolerance({"": ROUNDING}))
def objects(
    ctx: Context,
    truth: Truth,
    bodies: Collection[Body],
    placements: Collection[Placement],
    support: Support,
    camera: Camera,
    *,
    options: ObjectsOptions | None = None,
) -> Table:
    """Return one row per true object with its metrics and one per spurious asset, then statistics, the paper's row.

    Surfaces are compared in the camera frame [m]: scaled and placed bodies are transformed by the twin's
    T_world_camera, the truth by its own. Physics and collision geometry are not needed.
    """
    options = options or ObjectsOptions()
    if camera != truth.camera:
        ctx.fail(
            "the truth was seen through another camera",
            twin=camera,
            truth=truth.camera,
            hint="take `camera` from the capture of this world",
        )
    if support.scale == "unknown":
        ctx.fail(
            "the scale of this twin is unknown, so it cannot be compared with the truth",
            hint="state one size (`object` and `size_m` of `align.scale`), or lay a marker on the support",
        )
    known = true_objects(truth)
    found, rgb, depth = render(placed_bodies(bodies, placements, support), camera)
    overlaps = np.array([[metrics.mask_iou(f.mask, t.mask) for f in found.values()] for t in known.values()])
    pairs = metrics.match(overlaps.reshape(len(known), len(found)), options.match_iou)
    asset_of = {list(known)[row]: list(found)[column] for row, column in pairs}
    visible = counted(known, camera, options.least_visible, whole=options.whole)
    rows: list[tuple[Cell, ...]] = []
    for name in visible:
        if name in asset_of:
            numbers = _score(found[asset_of[name]], known[name], truth, rgb, depth, options)
            rows.append((name, asset_of[name], visible[name], *numbers))
        else:
            rows.append((name, "missed", visible[name], *MISSED))
    spurious = sorted(set(found) - set(asset_of.values()))
    ctx.preview(_outlines(truth, known, found), "truth green, twin magenta")
    rows += [(SPURIOUS, label, *[None] * (len(COLUMNS) - 2)) for label in spurious]
    return _table(ctx, rows, spurious, len(known) - len(visible), _sources(bodies), truth, options)


def _score(
    found: Seen, known: Seen, truth: Truth, rgb: np.ndarray, depth: np.ndarray, options: ObjectsOptions
) -> tuple[Cell, ...]:
    both = found.mask & known.mask
    shift = metrics.surface_centroid(found.vertices, found.faces) - metrics.surface_centroid(
        known.vertices, known.faces
    )
    points = [metrics.sample_surface(s.vertices, s.faces, options.samples, options.seed) for s in (found, known)]
    chamfer, score = metrics.chamfer_and_f(points[0], points[1], options.threshold_m)
    return (
        metrics.mask_iou(found.mask, known.mask),
        metrics.boundary_f1(found.mask, known.mask, options.boundary_tolerance),
        metrics.boundary_f1(found.mask, known.mask, 2.0),
        metrics.rgb_mae(rgb, truth.rgb.pixels, both),
        metrics.delta_e76(rgb, truth.rgb.pixels, both),
        metrics.depth_mae(depth, truth.depth.depth, both),
        float(np.linalg.norm(shift)),
        chamfer,
        score,
    )


def _table(
    ctx: Context,
    rows: list[tuple[Cell, ...]],
    spurious: list[str],
    hidden: int,
    sources: str,
    truth: Truth,
    options: ObjectsOptions,
) -> Table:
    columns = list(zip(*rows, strict=True))[2:] or [()] * (len(COLUMNS) - 2)
    summary = [metrics.mean_std([cell for cell in column if not isinstance(cell, str)]) for column in columns]
    missed = sum(row[1] == "missed" for row in rows)
    true = len(rows) - len(spurious)
    means = dict(zip((column.name for column in COLUMNS[2:]), (mean for mean, _, _ in summary), strict=True))
    for name, mean in means.items():
        if mean is not None:
            ctx.metric(name, mean, next(column.unit for column in COLUMNS if column.name == name))
    ctx.metric("missed", missed)
    ctx.metric("spurious", len(spurious))
    told = [f"{name} {means[name]:.3f}" for name in ("Mask IoU", "F-score@1cm") if means[name] is not None]
    ctx.say(", ".join([f"{true - missed} of {true} found, {len(spurious)} spurious", *told]))
    height, width = truth.labels.labels.shape
    tolerance = metrics.boundary_tolerance((height, width), options.boundary_tolerance)
    return Table(
        title="Objects of the twin against the truth",
        columns=COLUMNS,
        rows=(*rows, *(_summed(summary, sources) if options.summary else ())),
        notes=(
            f"{true} true objects: {true - missed} found, {missed} missed; {len(spurious)} spurious assets"
            + (f" ({', '.join(spurious)})" if spurious else ""),
            f"visible: part of the outline that is in the picture and not hidden; {hidden} objects are left "
            f"out, of which less than {options.least_visible:g} is visible"
            + (" or which the border of the picture cuts" if options.whole else ""),
            "a missed object counts with IoU 0; its other cells are empty, and `count` says over how many objects each "
            "mean goes; deviation is that of a sample",
            f"objects and assets are paired one to one by mask IoU (Hungarian), at least {options.match_iou:g}",
            f"boundary F1 as in DAVIS, tolerance {tolerance:g} px at {width} x {height} px, and 2 px; the paper does "
            "not state its tolerance",
            f"centroid, Chamfer-L1 (half the sum of both mean nearest distances) and F-score at "
            f"{100 * options.threshold_m:g} cm over the full surfaces, in the camera frame; {options.samples:,} points "
            f"each by area, seed {options.seed}",
            *DEFINITIONS,
        ),
    )


def _summed(summary: Sequence[tuple[Cell, Cell, Cell]], sources: str) -> Iterator[tuple[Cell, ...]]:
    for name, cells in zip(("mean", "deviation", "count"), zip(*summary, strict=True), strict=True):
        yield (name, sources if name == "mean" else None, *cells)
    yield from PAPER


def _sources(bodies: Collection[Body]) -> str:
    """`4 assets, rgbd`, or `3 assets, rgb; 1 asset, rgbd`."""
    counts = Counter(body.asset_source for body in bodies.items.values())
    return "; ".join(f"{n} {'asset' if n == 1 else 'assets'}, {source}" for source, n in sorted(counts.items()))


def _outlines(truth: Truth, known: dict[str, Seen], found: dict[str, Seen]) -> np.ndarray:
    picture = truth.rgb.pixels.copy()
    for things, colour in ((known, (60, 220, 60)), (found, (240, 40, 240))):
        for thing in things.values():
            picture[metrics.boundary(thing.mask)] = colour
    return picture
