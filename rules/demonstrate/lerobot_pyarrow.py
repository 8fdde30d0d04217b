"""demonstrate.lerobot written with pyarrow and PyAV."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.formats.h264 import Encoder
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options

from . import facts, lerobot_features, lerobot_meta, lerobot_stats, lerobot_tables, lerobot_v21, lerobot_videos, rolling
from .lerobot_actions import Actions

if TYPE_CHECKING:
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
    film: Film | None,
    view: View | None,
    out: Path,
    common: LerobotOptions,
    options: Options,
) -> None:
    """Write all files below `out`."""
    if common.version == lerobot_v21.VERSION:
        lerobot_v21.write(ctx, bundle, episodes, film, view, out, common)
        return
    actions = Actions(bundle)
    features = lerobot_features.features(episodes, layout.of_bundle(bundle).goal, actions.spec.names)
    words = facts.instruction(bundle, common)
    rows, stats = data(episodes, actions, features, words, common, out)
    video: dict[str, object] = {}
    if film is not None:
        key = lerobot_meta.picture_key(common)
        video = {key: lerobot_meta.video_feature(episodes, film.width, film.height)}
        stats[key] = _videos(ctx, episodes, film, rows, common, out)
    files = {
        lerobot_meta.EPISODES.format(chunk_index=0, file_index=0): lerobot_tables.episodes(rows),
        lerobot_meta.TASKS: lerobot_tables.tasks(words),
        "meta/info.json": facts.document(lerobot_meta.info(bundle, episodes, features, video, common)),
        "meta/stats.json": facts.document(lerobot_stats.plain(stats)),
        "meta/dextera.json": facts.document(facts.about(bundle, episodes)),
    }
    if view is not None:
        files["meta/cameras.json"] = facts.document(facts.cameras(bundle, view, common.camera))
    trees.write(files, out)


def data(
    episodes: Episodes,
    actions: Actions,
    features: dict[str, lerobot_features.Feature],
    words: str,
    options: LerobotOptions,
    out: Path,
) -> tuple[list[dict[str, object]], dict[str, lerobot_stats.Stats]]:
    """Write the data files; return the rows of `meta/episodes` and statistics of the whole set."""
    tables, rows, first = [], [], 0
    for number, (label, episode) in enumerate(episodes.in_order()):
        found = lerobot_features.columns(episodes, episode, number, first, actions.of(episode))
        columns = {name: found[name] for name in features}
        tables.append(columns)
        steps = len(episode.joints)
        row: dict[str, object] = {"episode_index": number, "tasks": [words], "length": steps}
        row |= {"dataset_from_index": first, "dataset_to_index": first + steps}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= flat({name: lerobot_stats.of_numbers(values) for name, values in columns.items()})
        rows.append(row | facts.start(label, episode))
        first += steps
    sizes = [sum(values.nbytes for values in columns.values()) / lerobot_videos.MEGABYTE for columns in tables]
    where = rolling.places(sizes, options.data_file_mb, options.files_per_chunk)
    for row, place in zip(rows, where, strict=True):
        row |= {"data/chunk_index": place.chunk, "data/file_index": place.file}
    for place, members in rolling.grouped(where).items():
        own = lerobot_tables.steps(features, [tables[number] for number in members])
        trees.write({place.path(lerobot_meta.DATA): own}, out)
    return rows, lerobot_stats.of_all(tables)


def _videos(
    ctx: Context, episodes: Episodes, film: Film, rows: list[dict[str, object]], options: LerobotOptions, out: Path
) -> lerobot_stats.Stats:
    """Write the camera's files and add its columns to `rows`; return statistics of all its pixels."""
    key = lerobot_meta.picture_key(options)
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
