"""LeRobot's metadata: names of files, and facts about the data set."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.declared import BY_NAME

from . import facts
from .lerobot_features import Feature

if TYPE_CHECKING:
    from .lerobot import LerobotOptions

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
TASKS = "meta/tasks.parquet"


def picture_key(options: LerobotOptions) -> str:
    """Name of the camera's feature."""
    return BY_NAME["rgb"].feature.format(options.camera)


def info(
    bundle: TaskBundle,
    episodes: Episodes,
    features: dict[str, Feature],
    video: dict[str, object],
    options: LerobotOptions,
) -> dict[str, object]:
    """The content of `meta/info.json`.

    Args:
        bundle: The task.
        episodes: The written episodes.
        features: Columns of the data files.
        video: Entry of each video feature, from `video_feature`.
        options: File sizes.
    """
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    return {
        "codebase_version": options.version,
        "robot_type": facts.robot_type(bundle),
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
        "features": {name: feature.facts() for name, feature in features.items()} | video,
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
