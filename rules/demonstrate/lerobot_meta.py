"""LeRobot's metadata: names of files, and facts about the data set."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.declared import BY_NAME

from . import facts
from .lerobot_features import Feature

if TYPE_CHECKING:
    from .cameras import Camera
    from .lerobot import LerobotOptions

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
TASKS = "meta/tasks.parquet"


def videos(episodes: Episodes, seen: Iterable[Camera]) -> dict[str, dict[str, object]]:
    """The entry of each video in `meta/info.json`, by feature."""
    return {
        picture_key(each): video_feature(episodes, each.film.width, each.film.height)
        for each in seen
        if each.film is not None
    }


def picture_key(camera: Camera) -> str:
    """Name of the feature of a camera's pictures."""
    return BY_NAME["rgb"].feature.format(camera.name)


def info(
    bundle: TaskBundle,
    episodes: Episodes,
    features: dict[str, Feature],
    video: Mapping[str, object],
    options: LerobotOptions,
    depth: Mapping[str, object] | None = None,
) -> dict[str, object]:
    """The content of `meta/info.json`.

    Args:
        bundle: The task.
        episodes: The written episodes.
        features: Columns of the data files.
        video: Entry of each video feature, from `video_feature`.
        options: File sizes.
        depth: Entry of each feature of depth.
    """
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    return {
        "codebase_version": options.version,
        "robot_type": bundle.robot.model_name,
        "total_episodes": len(episodes.items),
        "total_frames": steps,
        "total_tasks": 1,
        "chunks_size": options.files_per_chunk,
        "data_files_size_in_mb": math.ceil(options.data_file_mb),
        "video_files_size_in_mb": math.ceil(options.video_file_mb),
        "fps": facts.rate(episodes),
        "splits": {"train": f"0:{len(episodes.items)}"},
        "data_path": DATA,
        "video_path": VIDEO if video else None,
        "features": {name: feature.facts() for name, feature in features.items()} | {**video, **(depth or {})},
    }


def video_feature(episodes: Episodes, width: int, height: int) -> dict[str, object]:
    """The entry of one camera's video."""
    return {
        "dtype": "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": facts.rate(episodes),
            "video.channels": 3,
            "has_audio": False,
        },
    }
