"""capture.labels: read the ground-truth instance labels of a capture, for evaluation only."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.image import LabelImage
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from .pictures import counts


class LabelsOptions(Options):
    """Options of capture.labels."""

    file: str = "instances.png"
    """Label image in the capture's folder."""


@rule(version=1, packages=("pillow",))
def labels(ctx: Context, folder: Folder, *, options: LabelsOptions) -> LabelImage:
    """Return the labels of `instances.png`: 0 is background, 1.. are instances."""
    if options.file not in folder.files:
        ctx.fail(
            f"`{options.file}` is missing in the capture",
            here=listing(folder.files),
            hint="evaluate a capture that has true labels, or set option `file`",
        )
    values = counts(ctx, folder.files[options.file], options.file)
    ctx.say(f"{len(np.unique(values[values > 0]))} instances")
    return LabelImage(labels=values.astype(np.int32))
