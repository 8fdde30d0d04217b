"""Film strips: time-stamped pictures of one or more episodes at the same times."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np

from dextera_build.artifacts.tasks.task import View
from dextera_build.rule import Context

from .panels import GAP, PAPER, beside, titled
from .protocol import Record


def moments(steps: int, count: int) -> np.ndarray:
    """`count` evenly spaced rows of an episode of `steps` rows, including the first and the last."""
    return np.linspace(0, max(0, steps - 1), max(2, count)).round().astype(int)


def strip(rows: Mapping[str, np.ndarray], times_s: np.ndarray) -> np.ndarray:
    """Stack one row of pictures per label.

    Args:
        rows: Label -> pictures (N, H, W, 3) uint8.
        times_s: (N,) times since the start [s].
    """
    lines = []
    for label, pictures in rows.items():
        tiles = [
            titled(pixels, f"{label}  {time:.1f} s" if number == 0 else f"{time:.1f} s")
            for number, (pixels, time) in enumerate(zip(pictures, times_s, strict=True))
        ]
        lines.append(reduce(lambda left, right: beside(left, right, axis=1), tiles))
    sheet = reduce(lambda upper, lower: beside(upper, lower, axis=0), lines)
    return np.pad(sheet, ((GAP, GAP), (GAP, GAP), (0, 0)), constant_values=PAPER[0])


def first_of(views: Mapping[str, View]) -> View | None:
    """The camera of film strips: the first of a policy's cameras by name, or None."""
    return next((views[name] for name in sorted(views)), None)


def show(ctx: Context, record: Record, view: View | None, count: int) -> None:
    """Show a strip of `count` pictures of the first success and of the first failure, if the backend can render."""
    bundle = record.bundle
    for success in (True, False):
        number, attempt = record.examples.get(success, (0, None))
        episode = None if attempt is None else attempt.episode
        if episode is None:
            continue
        rows = moments(len(episode.action), count)
        pictures = ctx.backend.stills(ctx, bundle, episode, rows, view, ctx.backend_options)
        if pictures is not None:
            verdict = "success" if success else f"failure: {episode.reason}"
            times = rows / bundle.task.control_hz
            ctx.preview(strip({bundle.kind: pictures}, times), f"{bundle.task.name}, trial {number}, {verdict}")
