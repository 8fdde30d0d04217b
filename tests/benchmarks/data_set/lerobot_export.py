"""The data set as a LeRobotDataset v3.0, by the parts of `demonstrate.lerobot`; coded pictures are copied."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.core import trees
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.formats import video as video_files
from dextera_build.formats.h264 import Clip
from rules.demonstrate import facts, lerobot_features, lerobot_meta, lerobot_pyarrow, lerobot_stats, lerobot_tables
from rules.demonstrate.lerobot import LerobotOptions
from rules.demonstrate.lerobot_actions import Actions
from rules.demonstrate.lerobot_depth import Depths
from rules.demonstrate.lerobot_videos import videos as opened
from tests import episodes as made_up

SAMPLED = 10
"""Pictures per episode and camera that statistics are made of; LeRobot also takes a sample."""


def write(videos: dict[str, Collection[Video]], joints: Collection[Joints], rate_hz: float, out: Path) -> int:
    """Write the folder; return the number of pictures."""
    options, bundle = LerobotOptions(), made_up.bundle()
    episodes = _episodes(joints, rate_hz)
    features = lerobot_features.features(episodes, ("rise",))
    words = facts.instruction(bundle, options)
    rows, stats = lerobot_pyarrow.data(episodes, Actions(bundle), features, words, options, out, Depths(()))
    cameras: dict[str, object] = {}
    for camera, found in videos.items():
        key = f"observation.images.{camera}"
        first = next(iter(found.items.values()))
        cameras[key] = lerobot_meta.video_feature(episodes, first.width, first.height)
        stats[key] = _camera(found, key, rate_hz, rows, out)
    info = lerobot_meta.info(bundle, episodes, features, cameras, options)
    files = {
        lerobot_meta.EPISODES.format(chunk_index=0, file_index=0): lerobot_tables.episodes(rows),
        lerobot_meta.TASKS: lerobot_tables.tasks(words),
        "meta/info.json": facts.document(info),
        "meta/stats.json": facts.document(lerobot_stats.plain(stats)),
    }
    trees.write(files, out)
    return len(videos) * sum(len(episode.joints) for episode in episodes.items.values())


def _camera(
    found: Collection[Video], key: str, rate_hz: float, rows: list[dict[str, object]], out: Path
) -> lerobot_stats.Stats:
    """Write the files of one camera and add its columns to `rows`; return statistics of a sample of its pixels."""
    total, count = np.zeros((3, 256), np.int64), 0
    first = next(iter(found.items.values()))
    with opened(out, key, video_files.encoder(first.width, first.height, rate_hz), LerobotOptions()) as files:
        for row, label in zip(rows, found.items, strict=True):
            video = found.items[label]
            keys = np.flatnonzero(video.is_key)
            chosen = keys[np.linspace(0, len(keys) - 1, min(SAMPLED, len(keys))).astype(int)]
            counts = lerobot_stats.histogram(video.frames(chosen.tolist()))
            row |= lerobot_pyarrow.flat({key: lerobot_stats.of_pictures(counts, len(chosen))})
            row |= files.add(Clip([(_annex_b(data), key) for data, key in video.packets()]))
            total, count = total + counts, count + len(chosen)
    return lerobot_stats.of_pictures(total, count)


def _episodes(joints: Collection[Joints], rate_hz: float) -> Episodes:
    """The joint states as episodes; what else an episode records is made up."""
    base = made_up.small(1)
    pattern = base.items["0"]
    items = {}
    for label, found in joints.items.items():
        states = found.positions.astype(np.float32)
        items[label] = _episode(pattern, states)
    names = next(iter(joints.items.values())).names
    return base.model_copy(update={"items": items, "rate_hz": rate_hz, "joint_names": names})


def _episode(pattern: Episode, states: np.ndarray) -> Episode:
    steps = np.arange(len(states)) % len(pattern.joints)
    terms = {name: values[steps] for name, values in pattern.terms.items()} | {"joints": states}
    action = np.concatenate([states[1:], states[-1:]])
    commands = {"action": action, "executed": action, "hand": pattern.hand[steps]}
    return pattern.model_copy(update={"terms": terms, **commands})


def _annex_b(data: bytes) -> bytes:
    """A packet of an MP4 file, whose units begin with their length, as an encoder gives it: with start codes."""
    found, at = [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        found.append(b"\0\0\0\1" + data[at + 4 : at + 4 + size])
        at += 4 + size
    return b"".join(found)
