"""benchmark.scene_alignment_error: errors of scene alignments in several views with known poses."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Context, Options, rule

from ..evaluate.posed import PosedViews

COLUMNS = (
    Column(name="view"),
    Column(name="camera", unit="mm", digits=1, better="lower"),
    Column(name="surfaces", unit="mm", digits=1, better="lower"),
    Column(name="angle", unit="deg", digits=2, better="lower"),
    Column(name="scale", unit="%", digits=2, better="lower"),
    Column(name="stated", unit="mm", digits=1),
    Column(name="pairs", digits=0),
    Column(name="overlap", unit="%", digits=0),
    Column(name="believed"),
    Column(name="doubt"),
)
FAR_MM = 50.0
"""Position error of the camera above which an accepted alignment is counted as wrong [mm]."""


class SceneAlignmentErrorOptions(Options):
    """Options of benchmark.scene_alignment_error."""

    scale_factor: PositiveFloat = 1.0
    """Scene units per metre, unknown to the alignments."""


@rule(version=1, packages=("numpy", "pillow"))
def scene_alignment_error(
    ctx: Context, fits: Collection[SceneFit], views: Folder, *, options: SceneAlignmentErrorOptions | None = None
) -> Table:
    """Return the errors of each alignment against `views.json`, and the medians over the accepted ones and over all.

    The scene is in the axes of the camera of the folder's `capture.json`. `camera` is the position error of the camera
    in the scene at its true size; `surfaces` the median distance between the measured depth of the view and the
    scene's, at the estimated pose and at the true one.
    """
    options = options or SceneAlignmentErrorOptions()
    given = PosedViews(ctx, views)
    rows = [_row(name, fit, given, options.scale_factor) for name, fit in fits.items.items()]
    believed = [row for row in rows if row[8]]
    wrong = sum(isinstance(row[1], float) and row[1] > FAR_MM for row in believed)
    for name, some in (("believed", believed), ("all", rows)):
        medians = _medians(some)
        for column, value in zip(COLUMNS[1:5], medians, strict=True):
            if value is not None:
                ctx.metric(f"{column.name}, {name}", value, column.unit)
        rows = [*rows, (f"median of {name}", *medians, None, None, None, None, None)]
    ctx.metric(f"believed and off by more than {FAR_MM:g} mm", float(wrong))
    count = len(fits.items)
    ctx.say(f"{len(believed)} of {count} believed, {wrong} of these off by more than {FAR_MM:g} mm")
    return Table(
        title="A scene of unknown scale, aligned with other views of it",
        columns=COLUMNS,
        rows=tuple(rows),
        notes=(
            f"the scene has {options.scale_factor:g} lengths per metre, which align.scene does not know",
            "stated: standard deviation of the place; views that align.scene refused are not in the table",
        ),
    )


def _medians(rows: list[tuple[Cell, ...]]) -> list[float | None]:
    """Medians of the absolute errors of camera, surfaces, angle and scale."""
    columns = [[abs(cell) for row in rows if isinstance(cell := row[column], float)] for column in (1, 2, 3, 4)]
    return [float(np.median(each)) if each else None for each in columns]


def _row(name: str, fit: SceneFit, given: PosedViews, factor: float) -> tuple[Cell, ...]:
    frame = int(name.rpartition("_")[2])
    true = transforms.invert(given.poses[frame]) @ given.poses[given.own]
    motion = fit.motion
    off = motion.matrix[:3, :3] @ true[:3, :3].T
    camera = transforms.invert(motion.matrix)[:3, 3] / (motion.scale * factor)
    apart = float(np.linalg.norm(camera - transforms.invert(true)[:3, 3]))
    depth = given.view(frame).depth
    seen = cameras.backproject(depth, given.camera.matrix())[depth > 0][::7]
    scene = transforms.apply(transforms.invert(true), seen)
    _, _, inside = cameras.nearest_pixels(scene, given.camera.matrix(), depth.shape)
    shown = seen[inside]
    again = transforms.apply(motion.matrix, motion.scale * factor * scene[inside])
    moved = float(np.median(np.linalg.norm(again - shown, axis=1))) if len(shown) else None
    spread = None if motion.covariance is None else 1000 * float(np.sqrt(np.trace(motion.covariance[:3, :3])))
    return (
        name,
        1000 * apart,
        None if moved is None else 1000 * moved,
        float(np.degrees(transforms.angle(off))),
        100 * (motion.scale * factor - 1),
        spread,
        fit.evidence.inliers,
        100 * fit.evidence.overlap,
        not fit.doubts,
        fit.doubts[0] if fit.doubts else "",
    )
