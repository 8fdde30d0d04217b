"""demonstrate.lerobot written with pyarrow and PyAV."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats.h264 import Encoder
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options

from . import facts, lerobot_features, lerobot_meta, lerobot_stats, lerobot_tables, lerobot_v21, lerobot_videos, rolling
from .lerobot_actions import Actions
from .lerobot_depth import Depths

if TYPE_CHECKING:
    from .cameras import Camera
    from .lerobot import LerobotOptions

BACKEND = Backend(
    summary="Parquet by pyarrow, H.264 by PyAV",
    profiles=("cpu",),
    packages=("pyarrow", "av"),
    extra="learn",
)


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: LerobotOptions,
    options: Options,
) -> None:
    """Write all files below `out`."""
    if common.version == lerobot_v21.VERSION:
        lerobot_v21.write(ctx, bundle, episodes, seen, out, common)
        return
    actions = Actions(bundle)
    features = lerobot_features.features(episodes, layout.of_bundle(bundle).goal, actions.spec.names)
    words = facts.instruction(bundle, common)
    depths = Depths(seen)
    rows, stats = data(episodes, actions, features, words, common, out, depths)
    for each in seen:
        if each.film is not None:
            key = lerobot_meta.picture_key(each)
            stats[key] = _videos(ctx, episodes, key, each.film, rows, common, out)
    info = lerobot_meta.info(
        bundle, episodes, features, lerobot_meta.videos(episodes, seen), common, depths.described()
    )
    files = {
        lerobot_meta.EPISODES.format(chunk_index=0, file_index=0): lerobot_tables.episodes(rows),
        lerobot_meta.TASKS: lerobot_tables.tasks(words),
        "meta/info.json": facts.document(info),
        "meta/stats.json": facts.document(lerobot_stats.plain(stats)),
        "meta/dextera.json": facts.document(facts.about(bundle, episodes)),
    }
    if cameras := facts.cameras(bundle, seen):
        files["meta/cameras.json"] = facts.document(cameras)
    trees.write(files, out)


def data(
    episodes: Episodes,
    actions: Actions,
    features: dict[str, lerobot_features.Feature],
    words: str,
    options: LerobotOptions,
    out: Path,
    depths: Depths,
) -> tuple[list[dict[str, object]], dict[str, lerobot_stats.Stats]]:
    """Write the data files; return the rows of `meta/episodes` and statistics of the whole set."""
    tables, rows, first = [], [], 0
    files = _DataFiles(features, options, out)
    for number, (label, episode) in enumerate(episodes.in_order()):
        found = lerobot_features.columns(episodes, episode, number, first, actions.of(episode))
        columns = {name: found[name] for name in features}
        tables.append(columns)
        pictures, seen = depths.of(label)
        place = files.add(columns, pictures)
        steps = len(episode.joints)
        row: dict[str, object] = {"episode_index": number, "tasks": [words], "length": steps}
        row |= {"dataset_from_index": first, "dataset_to_index": first + steps}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= flat({name: lerobot_stats.of_numbers(values) for name, values in columns.items()} | seen)
        row |= facts.start(label, episode) | {"data/chunk_index": place.chunk, "data/file_index": place.file}
        rows.append(row)
        first += steps
    files.close()
    return rows, lerobot_stats.of_all(tables) | depths.whole()


class _DataFiles:
    """Writes the data files in turn, with the episodes of one file in memory."""

    def __init__(self, features: dict[str, lerobot_features.Feature], options: LerobotOptions, out: Path) -> None:
        self._features, self._out = features, out
        self._roll = rolling.Roll(options.data_file_mb, options.files_per_chunk)
        self._place: rolling.Place | None = None
        self._episodes: list[lerobot_tables.Columns] = []

    def add(self, columns: dict[str, np.ndarray], pictures: dict[str, list[bytes]]) -> rolling.Place:
        """Append an episode of numbers (T, N) and encoded pictures; return its file."""
        size = sum(values.nbytes for values in columns.values())
        size += sum(len(each) for found in pictures.values() for each in found)
        place = self._roll.place(size / lerobot_videos.MEGABYTE)
        if place != self._place:
            self.close()
        self._place = place
        self._episodes.append({**columns, **pictures})
        return place

    def close(self) -> None:
        """Complete the last file."""
        if self._place is not None:
            own = lerobot_tables.steps(self._features, self._episodes)
            trees.write({self._place.path(lerobot_meta.DATA): own}, self._out)
        self._episodes = []


def _videos(
    ctx: Context,
    episodes: Episodes,
    key: str,
    film: Film,
    rows: list[dict[str, object]],
    options: LerobotOptions,
    out: Path,
) -> lerobot_stats.Stats:
    """Write a camera's files and add its columns to `rows`; return statistics of all its pixels."""
    rate = Fraction(episodes.rate_hz).limit_denominator(1001)
    encoder = Encoder(film.width, film.height, rate, options.qp, options.keyframe_every)
    total, frames = np.zeros((3, 256), np.int64), 0
    with lerobot_videos.videos(out, key, encoder, options) as files:
        for number, (label, _) in enumerate(episodes.in_order()):
            counts = np.zeros((3, 256), np.int64)
            clip = encoder.encode(lerobot_stats.counted(film.each(label), counts))
            rows[number] |= flat({key: lerobot_stats.of_pictures(counts, len(clip.packets))}) | files.add(clip)
            total += counts
            frames += len(clip.packets)
            ctx.progress(number + 1, len(rows), "videos")
    return lerobot_stats.of_pictures(total, frames)


def flat(stats: dict[str, lerobot_stats.Stats]) -> dict[str, object]:
    """Statistics by feature as columns of `meta/episodes`."""
    return {f"stats/{feature}/{name}": value.tolist() for feature, own in stats.items() for name, value in own.items()}
