"""demonstrate.rlds without episodes: only the JSON files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

from . import form, rlds_meta
from .lerobot_actions import Actions

if TYPE_CHECKING:
    from .cameras import Camera
    from .rlds import RldsOptions

BACKEND = Backend(summary="facts only, no records", profiles=("stub",))


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: RldsOptions,
    options: Options,
) -> None:
    """Write `features.json` and `dataset_info.json`."""
    actions = Actions(bundle)
    splits = [rlds_meta.Split("train", (len(episodes.items),), 0)]
    about = rlds_meta.about(bundle, episodes, seen)
    files = {
        "features.json": rlds_meta.features(
            form.observed(bundle, episodes, actions), len(actions.spec.names), seen, common
        ),
        "dataset_info.json": rlds_meta.info(out.parent.name, out.name, about, splits),
    }
    trees.write(files, out)
