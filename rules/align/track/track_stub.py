"""Backend stub of align.track: nothing moves, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.rule import Backend, Context, Options
from dextera_build.tracking.tracked_object import Tracked

if TYPE_CHECKING:
    from .track import Job

BACKEND = Backend(summary="the start poses in all frames, for tests", profiles=("stub",))


def track(ctx: Context, job: Job, options: Options) -> list[dict[str, Tracked]]:
    """The start poses with status predicted."""
    row = {
        name: Tracked(
            status="predicted",
            pose=pose,
            covariance=np.diag([0.01] * 3 + [0.1] * 3) ** 2,
            joints=np.array([joint.position for joint in job.assets[name].body.joints], np.float64),
            joint_sigmas=np.zeros(len(job.assets[name].body.joints)),
            visible=0.0,
            why="nothing is measured",
        )
        for name, pose in job.starts.items()
    }
    return [row for _ in job.numbers]
