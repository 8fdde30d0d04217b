"""Writing a data set in one of its forms."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.core.lazy import sizes
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Context

from . import card
from .cameras import Camera
from .form import Form, FormOptions


def written(
    ctx: Context[Any],
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    described: Form,
    options: FormOptions,
    inside: str = "",
) -> tuple[Folder, float]:
    """The files of the backend with the card, and their size [MB], which becomes the metric `size`.

    Args:
        ctx: Context with the backend.
        bundle: The task.
        episodes: Its episodes.
        seen: Its cameras.
        described: The form, for the card.
        options: The rule's options.
        inside: Folder for the backend's files, below that of the card.
    """
    out = Path(tempfile.mkdtemp(dir=ctx.scratch))
    (out / inside).mkdir(parents=True, exist_ok=True)
    ctx.backend.write(ctx, bundle, episodes, seen, out / inside, options, ctx.backend_options)
    card.write(bundle, episodes, seen, described, options, out)
    found = Folder.of(out)
    megabytes = sum(sizes(found.files)) / 1e6
    ctx.metric("size", megabytes, "MB")
    return found, megabytes
