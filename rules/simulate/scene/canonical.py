"""simulate.canonical: one object in its canonical frame."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.canonical import CanonicalFrame
from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import transforms
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy",))
def canonical(ctx: Context, asset: Asset, frame: CanonicalFrame) -> Asset:
    """Return the asset with its canonical frame [m] as object frame: z is up, x its front, the origin below its centre.

    Meshes, walls, joints, masses, inertias and collision pieces are transformed together, and nothing moves in the
    world. `frame` is that of `align.canonical` for the body of this asset, in metres.
    """
    found = similar.asset(asset, frame.motion())
    turn = float(np.degrees(transforms.angle(frame.pose.matrix[:3, :3])))
    shift = 1000 * float(np.linalg.norm(frame.pose.matrix[:3, 3]))
    left = f", undecided: {', '.join(frame.undecided)}" if frame.undecided else ""
    ctx.say(f"turned by {turn:.0f} deg, origin moved by {shift:.0f} mm{left}")
    return found
