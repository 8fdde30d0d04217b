"""demonstrate.lerobot written with pyarrow and PyAV."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.episode import Episodes, Film
from dextera_build.artifacts.h264 import Clip, Encoder
from dextera_build.artifacts.task import TaskBundle, View
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options

from . import lerobot_features, lerobot_meta, lerobot_stats, lerobot_tables, rolling

if TYPE_CHECKING:
    from .lerobot import LerobotOptions

BACKEND = Backend(
    summary="Parquet by pyarrow, H.264 by PyAV",
    profiles=("cpu",),
    packages=("pyarrow", "av"),
    extra="learn",
)
MEGABYTE = 1024.0 * 1024.0
LONGEST_S = 1000.0
"""Maximum duration of a video file [s]: LeRobot's loader compares times in single precision to 0.1 ms, and from 1024 s
the spacing of single precision numbers is larger."""


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None,
    view: View | None,
    common: LerobotOptions,
    options: Options,
) -> dict[str, bytes]:
    """Path -> content of the whole folder; all files are complete."""
    goal = layout.of_bundle(bundle).goal
    features = lerobot_features.features(episodes, goal)
    words = lerobot_meta.instruction(bundle, common)
    rows, stats, files = _data(episodes, features, words, common)
    video: dict[str, object] = {}
    if film is not None:
        key = lerobot_meta.picture_key(common)
        video = {key: lerobot_meta.video_feature(episodes, film.width, film.height)}
        stats[key] = _videos(ctx, episodes, film, rows, files, common)
    files[lerobot_meta.EPISODES.format(chunk_index=0, file_index=0)] = lerobot_tables.episodes(rows)
    files[lerobot_meta.TASKS] = lerobot_tables.tasks(words)
    files["meta/info.json"] = lerobot_meta.document(lerobot_meta.info(bundle, episodes, features, video, common))
    files["meta/stats.json"] = lerobot_meta.document(lerobot_stats.plain(stats))
    files["meta/dextera.json"] = lerobot_meta.document(lerobot_meta.about(bundle, episodes))
    if view is not None:
        files["meta/cameras.json"] = lerobot_meta.document(lerobot_meta.cameras(bundle, view, common.camera))
    return files


def _data(
    episodes: Episodes, features: dict[str, lerobot_features.Feature], words: str, options: LerobotOptions
) -> tuple[list[dict[str, object]], dict[str, lerobot_stats.Stats], dict[str, bytes]]:
    """Rows of `meta/episodes`, statistics of the whole set, and the data files."""
    tables, rows, first = [], [], 0
    for number, (label, episode) in enumerate(episodes.in_order()):
        found = lerobot_features.columns(episodes.rate_hz, episode, number, first)
        columns = {name: found[name] for name in features}
        tables.append(columns)
        steps = len(episode.joints)
        row: dict[str, object] = {"episode_index": number, "tasks": [words], "length": steps}
        row |= {"dataset_from_index": first, "dataset_to_index": first + steps}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= _flat({name: lerobot_stats.of_numbers(values) for name, values in columns.items()})
        rows.append(row | lerobot_meta.start(label, episode))
        first += steps
    sizes = [sum(values.nbytes for values in columns.values()) / MEGABYTE for columns in tables]
    where = rolling.places(sizes, options.data_file_mb, options.files_per_chunk)
    for row, place in zip(rows, where, strict=True):
        row |= {"data/chunk_index": place.chunk, "data/file_index": place.file}
    files = {
        place.path(lerobot_meta.DATA): lerobot_tables.steps(features, [tables[number] for number in members])
        for place, members in rolling.grouped(where).items()
    }
    whole = {name: np.concatenate([columns[name] for columns in tables]) for name in features}
    return rows, {name: lerobot_stats.of_numbers(values) for name, values in whole.items()}, files


def _videos(
    ctx: Context,
    episodes: Episodes,
    film: Film,
    rows: list[dict[str, object]],
    files: dict[str, bytes],
    options: LerobotOptions,
) -> lerobot_stats.Stats:
    """Add the camera's files to `files` and its columns to `rows`; return statistics of all its pixels."""
    key = lerobot_meta.picture_key(options)
    rate = Fraction(episodes.rate_hz).limit_denominator(1001)
    encoder = Encoder(film.width, film.height, rate, options.crf, options.keyframe_every)
    clips: list[Clip] = []
    total = np.zeros((3, 256), np.int64)
    for number, (label, _) in enumerate(episodes.in_order()):
        pixels = film.pixels(label)
        counts = lerobot_stats.histogram(pixels)
        rows[number] |= _flat({key: lerobot_stats.of_pictures(counts, len(pixels))})
        total += counts
        clips.append(encoder.encode(pixels))
        ctx.progress(number + 1, len(rows), "videos")
    limit = LONGEST_S * episodes.rate_hz
    sizes = [max(clip.size / MEGABYTE / options.video_file_mb, len(clip.packets) / limit) for clip in clips]
    where = rolling.places(sizes, 1.0, options.files_per_chunk)
    for place, members in rolling.grouped(where).items():
        files[place.path(lerobot_meta.VIDEO, video_key=key)] = encoder.mp4([clips[number] for number in members])
        frame = 0
        for number in members:
            row, last = rows[number], frame + len(clips[number].packets)
            row |= {f"videos/{key}/chunk_index": place.chunk, f"videos/{key}/file_index": place.file}
            row |= {
                f"videos/{key}/from_timestamp": float(frame / rate),
                f"videos/{key}/to_timestamp": float(last / rate),
            }
            frame = last
    return lerobot_stats.of_pictures(total, sum(len(clip.packets) for clip in clips))


def _flat(stats: dict[str, lerobot_stats.Stats]) -> dict[str, object]:
    return {f"stats/{feature}/{name}": value.tolist() for feature, own in stats.items() for name, value in own.items()}
