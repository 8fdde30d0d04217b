"""Backend `visible` of factorize.complete: what was seen, and nothing else.

The shapes that `primitives` fits take occluder pixels as unknown, and depth there is that of the nearer thing.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.view import ObjectView
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="what was seen; completes nothing", profiles=("stub",))


def complete(ctx: Context, view: ObjectView, options: Options) -> tuple[np.ndarray, np.ndarray]:
    """Colours and mask as they were seen."""
    return view.rgb.pixels, view.mask
