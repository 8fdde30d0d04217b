"""demonstrate.lerobot without Parquet and video: only the JSON files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options

from . import facts, lerobot_features, lerobot_meta, lerobot_stats
from .lerobot_actions import Actions
from .lerobot_depth import Depths

if TYPE_CHECKING:
    from .cameras import Camera
    from .lerobot import LerobotOptions

BACKEND = Backend(summary="facts and statistics only, no data files", profiles=("stub",))


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: LerobotOptions,
    options: Options,
) -> None:
    """Write `meta/info.json`, `meta/stats.json` and `meta/dextera.json`."""
    actions = Actions(bundle)
    features = lerobot_features.features(episodes, layout.of_bundle(bundle).goal, actions.spec.names)
    parts = [
        lerobot_features.columns(episodes, episode, number, 0, actions.of(episode))
        for number, (_, episode) in enumerate(episodes.in_order())
    ]
    stats = lerobot_stats.of_all([{name: columns[name] for name in features} for columns in parts])
    video, depth = lerobot_meta.videos(episodes, seen), Depths(seen).described()
    files = {
        "meta/info.json": facts.document(lerobot_meta.info(bundle, episodes, features, video, common, depth)),
        "meta/stats.json": facts.document(lerobot_stats.plain(stats)),
        "meta/dextera.json": facts.document(facts.about(bundle, episodes)),
    }
    trees.write(files, out)
