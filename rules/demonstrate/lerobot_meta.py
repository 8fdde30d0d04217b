"""LeRobot's metadata: facts about the data set, and a row for every episode."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.declared import BY_NAME

from .lerobot_actions import Actions
from .lerobot_features import Feature

if TYPE_CHECKING:
    from .form import FormOptions
    from .lerobot import LerobotOptions

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
TASKS = "meta/tasks.parquet"


def instruction(bundle: TaskBundle, options: FormOptions) -> str:
    """The task in words."""
    return options.instruction or " ".join(re.findall(r"[A-Z]?[^A-Z]+|[A-Z]+", bundle.task.name)).lower()


def picture_key(options: FormOptions) -> str:
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
        "robot_type": robot_type(bundle),
        "total_episodes": len(episodes.items),
        "total_frames": steps,
        "total_tasks": 1,
        "chunks_size": options.files_per_chunk,
        "data_files_size_in_mb": math.ceil(options.data_file_mb),
        "video_files_size_in_mb": math.ceil(options.video_file_mb),
        "fps": rate(episodes),
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
            "video.fps": rate(episodes),
            "video.channels": 3,
            "has_audio": False,
        },
    }


def rate(episodes: Episodes) -> float | int:
    """Control rate [Hz], as an integer if it is whole, because LeRobot declares an integer."""
    return int(episodes.rate_hz) if episodes.rate_hz == int(episodes.rate_hz) else episodes.rate_hz


def robot_type(bundle: TaskBundle) -> str:
    """The robot's name in its MJCF."""
    head = bundle.robot.model.files.get("robot.xml", b"")[:4096].decode(errors="replace")
    named = re.search(r'<mujoco[^>]*\smodel="([^"]+)"', head)
    return named[1] if named else "unknown"


def start(label: str, episode: Episode) -> dict[str, object]:
    """Columns with the start of the episode and its origin."""
    begin = episode.start
    names = ("mass_scale", "size_scale", "friction", "gain_scale", "base_error")
    dynamics = {name: getattr(begin, name) for name in names}
    return {
        "label": label,
        "origin": episode.origin,
        "success": episode.success,
        "segments": _line([segment.model_dump() for segment in episode.segments]),
        "start/seed": begin.seed,
        "start/qpos": begin.qpos.tolist(),
        "start/ctrl": begin.ctrl.tolist(),
        "start/dynamics": _line(dynamics),
    }


def about(bundle: TaskBundle, episodes: Episodes) -> dict[str, object]:
    """`meta/dextera.json`: the meaning of the columns, and discarded attempts with their reasons."""
    return {
        "task": bundle.task.model_dump(mode="json"),
        "world": bundle.kind,
        "embodiment": episodes.embodiment,
        "action": Actions(bundle).about(),
        "model": digest.of_bytes(bundle.model.files.get("scene.xml", b"")),
        "world_from_base": bundle.base_pose.matrix.tolist(),
        "frames": "poses and forces are in the robot's base frame; metres, radians, newtons; quaternions w x y z",
        "start": "start/qpos is MuJoCo's qpos of the task's model, start/ctrl its targets; set both to begin again",
        "attempts": episodes.attempts,
        "failures": {label: failed.reason for label, failed in sorted(episodes.failures.items())},
    }


def cameras(bundle: TaskBundle, view: View, name: str) -> dict[str, object]:
    """`meta/cameras.json`: intrinsics [px] and poses of the cameras, OpenCV axes, integer pixel centres."""
    base = (bundle.base_pose.inverse() @ view.camera_pose).matrix
    return {
        name: view.camera.model_dump(mode="json")
        | {"base_from_camera": base.tolist(), "world_from_camera": view.camera_pose.matrix.tolist()}
    }


def document(value: object) -> bytes:
    """Indented JSON with deterministic bytes."""
    return (json.dumps(value, indent=4, ensure_ascii=False, default=_number) + "\n").encode()


def _line(value: object) -> str:
    return json.dumps(value, sort_keys=True)


def _number(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not plain")
