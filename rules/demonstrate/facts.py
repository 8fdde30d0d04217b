"""Facts about a data set that every form states, and a JSON document of them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.instruction import of_task

from .lerobot_actions import Actions

if TYPE_CHECKING:
    from .cameras import Camera
    from .form import FormOptions


def instruction(bundle: TaskBundle, options: FormOptions) -> str:
    """The task in words."""
    return options.instruction or of_task(bundle.task)


def rate(episodes: Episodes) -> float | int:
    """Control rate [Hz], as an integer if it is whole, because LeRobot declares an integer."""
    return int(episodes.rate_hz) if episodes.rate_hz == int(episodes.rate_hz) else episodes.rate_hz


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
        "world": episodes.world,
        "embodiment": episodes.embodiment,
        "action": Actions(bundle).about(),
        "model": digest.of_bytes(bundle.model.files.get("scene.xml", b"")),
        "world_from_base": bundle.base_pose.matrix.tolist(),
        "frames": "poses and forces are in the robot's base frame; metres, radians, newtons; quaternions w x y z",
        "start": "start/qpos is MuJoCo's qpos of the task's model, start/ctrl its targets; set both to begin again",
        "attempts": episodes.attempts,
        "failures": {label: failed.reason for label, failed in sorted(episodes.failures.items())},
    }


def cameras(bundle: TaskBundle, seen: Iterable[Camera]) -> dict[str, object]:
    """`meta/cameras.json`: intrinsics [px] and poses of the cameras, OpenCV axes, integer pixel centres."""
    return {each.name: _camera(bundle, each.view) for each in seen if each.view is not None}


def _camera(bundle: TaskBundle, view: View) -> dict[str, object]:
    base = (bundle.base_pose.inverse() @ view.camera_pose).matrix
    poses = {"base_from_camera": base.tolist(), "world_from_camera": view.camera_pose.matrix.tolist()}
    return view.camera.model_dump(mode="json") | poses


def document(value: object) -> bytes:
    """Indented JSON with deterministic bytes."""
    return (json.dumps(value, indent=4, ensure_ascii=False, default=_number) + "\n").encode()


def _line(value: object) -> str:
    return json.dumps(value, sort_keys=True)


def _number(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not plain")
