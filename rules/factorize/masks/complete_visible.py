"""Backend `visible` of factorize.complete: visible pixels only, without completion.

Backend `primitives` of factorize.mesh treats occluder pixels as unknown; depth there is that of the nearer object.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the visible part; completes nothing", profiles=("stub",))


def complete(ctx: Context, view: ObjectView, options: Options) -> tuple[np.ndarray, np.ndarray]:
    """The visible colours and mask, unchanged."""
    return view.rgb.pixels, view.mask
