"""factorize.state: a second capture of the same objects with their joints in other positions."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import MeasuredView, State
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Context, rule

from ..regions.heights import least_height

LEAST_POINTS = 200
"""Minimum number of measured pixels above the support."""


@rule(version=1)
def state(ctx: Context, capture: Capture, support: Support) -> State:
    """Return the measurements of the second capture, in the world of its own support [m]."""
    if capture.measured is None:
        ctx.fail(
            "the second capture has no depth", hint="add it: joints are found by comparing the depth of both captures"
        )
    depth, camera = capture.measured.depth, capture.photograph.camera
    points = cameras.backproject(depth.depth.astype(np.float64), camera.matrix())
    height = transforms.apply(support.camera_pose.matrix, points)[..., 2]
    above = (depth.depth > 0) & (height > least_height(depth.depth))
    ctx.check(
        int(above.sum()) >= LEAST_POINTS,
        f"the second capture shows {int(above.sum())} measured pixels above its support",
        hint="check its depth, and the plane of its `align.support`",
        needed=LEAST_POINTS,
    )
    ctx.say(f"{int(above.sum()):,} px above the support")
    return State(measured=MeasuredView(depth=depth, camera_pose=support.camera_pose), camera=camera, above=above)
