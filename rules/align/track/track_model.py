"""Backend model of align.track: frame-to-model registration of depth, outline and brightness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import PositiveFloat

from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.tracking.model import Model
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker, Tuning

if TYPE_CHECKING:
    from .track import Job

BACKEND = Backend(
    summary="frame to model: depth, outline and brightness, gated and searched again",
    profiles=("cpu",),
    packages=("open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


class ModelOptions(Options):
    """Options of backend `model` of align.track."""

    patience_s: PositiveFloat = 0.5
    """Time without a measurement after which an object is lost [s]."""
    hidden_s: PositiveFloat = 3.0
    """The same for a static object that is occluded [s]."""


def track(ctx: Context, job: Job, options: ModelOptions) -> list[dict[str, Tracked]]:
    """Poses by `geometry.tracking.tracker.Tracker`, which also runs on a live camera."""
    models = {name: Model.of(asset.body, asset.body.residual_m) for name, asset in job.assets.items()}
    tuning = Tuning(patience_s=options.patience_s, hidden_s=options.hidden_s)
    tracker = Tracker(models, job.video.camera.matrix(), tuning)
    tracker.start(job.starts)
    found, before = [], None
    begin = job.video.stamps[job.numbers[0]]
    for done, (frame, masks) in enumerate(job.frames(), 1):
        ctx.progress(done, len(job.numbers), "frames")
        moved = None
        if job.moves == "stands":
            moved = np.eye(4)
        elif job.moves == "stated" and frame.pose is not None:
            moved = np.eye(4) if before is None else transforms.invert(frame.pose) @ before
            before = frame.pose
        # Frames before the first one are tracked backwards, so time is counted from it.
        stamp = abs(frame.stamp - begin)
        found.append(tracker.step(frame.rgb, frame.depth, stamp, masks=masks, moved=moved))
    return found
