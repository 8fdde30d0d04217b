"""LeRobotDataset v2.1, a file per episode, with `modality.json` and `stats.json`: what openpi and GR00T read.

GR00T scales by the statistics of the whole set in `meta/stats.json`, with quantiles and without pictures, which LeRobot
up to 0.3 ignores in this version.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats.h264 import Encoder
from dextera_build.policy import layout
from dextera_build.policy.declared import BY_NAME
from dextera_build.rule import Context

from . import facts, lerobot_features, lerobot_meta, lerobot_stats, lerobot_tables
from .lerobot_actions import Actions
from .lerobot_depth import Depths

if TYPE_CHECKING:
    from .cameras import Camera
    from .lerobot import LerobotOptions

VERSION = "v2.1"
DATA = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
KNOWN = ("min", "max", "mean", "std", "count")
"""Statistics of an episode in this version, which has no quantiles, and refuses those of pictures that have not three
channels; so depth has none."""


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: LerobotOptions,
) -> None:
    """Write all files below `out`."""
    actions, words = Actions(bundle), facts.instruction(bundle, common)
    features = lerobot_features.features(episodes, layout.of_bundle(bundle).goal, actions.spec.names)
    depths = Depths(seen)
    rows, stats, whole, first = [], [], [], 0
    for number, (label, episode) in enumerate(episodes.in_order()):
        found = lerobot_features.columns(episodes, episode, number, first, actions.of(episode))
        columns = {name: found[name] for name in features}
        whole.append(columns)
        pictures, _ = depths.of(label)
        trees.write({_place(DATA, number, common): lerobot_tables.steps(features, [{**columns, **pictures}])}, out)
        stats.append({name: lerobot_stats.of_numbers(values) for name, values in columns.items()})
        steps = len(episode.joints)
        rows.append({"episode_index": number, "tasks": [words], "length": steps} | facts.start(label, episode))
        first += steps
    for each in seen:
        if each.film is not None:
            key = lerobot_meta.picture_key(each)
            for own, of_video in zip(stats, _videos(ctx, episodes, key, each.film, out, common), strict=True):
                own[key] = of_video
    video = lerobot_meta.videos(episodes, seen)
    files = {
        "meta/info.json": facts.document(_info(bundle, episodes, features, video, common, depths)),
        "meta/tasks.jsonl": _lines([{"task_index": 0, "task": words}]),
        "meta/episodes.jsonl": _lines(rows),
        "meta/episodes_stats.jsonl": _lines(
            {"episode_index": number, "stats": lerobot_stats.plain({name: _known(one) for name, one in own.items()})}
            for number, own in enumerate(stats)
        ),
        "meta/stats.json": facts.document(lerobot_stats.plain(lerobot_stats.of_all(whole))),
        "meta/modality.json": facts.document(modality(bundle, features, seen)),
        "meta/dextera.json": facts.document(facts.about(bundle, episodes)),
    }
    if cameras := facts.cameras(bundle, seen):
        files["meta/cameras.json"] = facts.document(cameras)
    trees.write(files, out)


def modality(
    bundle: TaskBundle, features: Mapping[str, lerobot_features.Feature], seen: Sequence[Camera]
) -> dict[str, object]:
    """GR00T's `modality.json`: named parts of state and action, from `start` up to but without `end`.

    The robot's joints are divided by limb into arm and hand, and so are actions that are joint targets. Other
    observations are parts of their own, with their feature as `original_key`.

    Args:
        bundle: The task.
        features: Columns of the data files.
        seen: The cameras; GR00T reads no depth.
    """
    robot = bundle.robot
    owner = {
        name: f"{limb}_{group}"
        for limb in robot.limb_names
        for group in ("arm", "hand")
        for name in getattr(robot.limbs[limb], group)
    }
    names = [owner.get(joint.name, "others") for joint in robot.joints]
    state, action = BY_NAME["joints"].feature, lerobot_features.ACTION
    width = features[action].width
    joints = bundle.task.action == "joint"
    return {
        "state": {
            **_parts(names, state),
            **{
                name.removeprefix("observation."): {"original_key": name, "start": 0, "end": feature.width}
                for name, feature in features.items()
                if name.startswith("observation.") and name != state
            },
        },
        "action": _parts(names, action) if joints else {"action": {"original_key": action, "start": 0, "end": width}},
        "video": {each.name: {"original_key": lerobot_meta.picture_key(each)} for each in seen if each.film},
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    }


def _parts(names: list[str], feature: str) -> dict[str, dict[str, object]]:
    """Runs of equal names; the second run of a name is called `name_2`."""
    found: dict[str, dict[str, object]] = {}
    first = 0
    for name, run in groupby(names):
        last = first + len(list(run))
        count = sum(each == name or each.rpartition("_")[0] == name for each in found)
        key = f"{name}_{count + 1}" if name in found else name
        found[key] = {"original_key": feature, "start": first, "end": last}
        first = last
    return found


def _info(
    bundle: TaskBundle,
    episodes: Episodes,
    features: dict[str, lerobot_features.Feature],
    video: Mapping[str, object],
    options: LerobotOptions,
    depths: Depths,
) -> dict[str, object]:
    found = lerobot_meta.info(bundle, episodes, features, video, options, depths.described())
    count = len(episodes.items)
    for name in ("data_files_size_in_mb", "video_files_size_in_mb"):
        del found[name]
    return found | {
        "total_videos": count * len(video),
        "total_chunks": -(-count // options.files_per_chunk),
        "data_path": DATA,
        "video_path": VIDEO if video else None,
    }


def _videos(
    ctx: Context, episodes: Episodes, key: str, film: Film, out: Path, options: LerobotOptions
) -> Iterator[lerobot_stats.Stats]:
    """Write a file per episode, and yield statistics of its pixels."""
    rate = Fraction(episodes.rate_hz).limit_denominator(1001)
    encoder = Encoder(film.width, film.height, rate, options.qp, options.keyframe_every)
    for number, (label, _) in enumerate(episodes.in_order()):
        counts = np.zeros((3, 256), np.int64)
        clip = encoder.encode(lerobot_stats.counted(film.each(label), counts))
        path = out / _place(VIDEO, number, options, video_key=key)
        path.parent.mkdir(parents=True, exist_ok=True)
        with encoder.joined(path) as append:
            append(clip)
        yield lerobot_stats.of_pictures(counts, len(clip.packets))
        ctx.progress(number + 1, len(episodes.items), "videos")


def _place(template: str, number: int, options: LerobotOptions, **names: str) -> str:
    return template.format(episode_chunk=number // options.files_per_chunk, episode_index=number, **names)


def _known(stats: lerobot_stats.Stats) -> lerobot_stats.Stats:
    return {name: stats[name] for name in KNOWN}


def _lines(rows: Iterable[object]) -> bytes:
    """JSON Lines."""
    return "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows).encode()
