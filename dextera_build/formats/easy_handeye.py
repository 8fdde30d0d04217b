"""The YAML files of easy_handeye and easy_handeye2, ROS packages for hand-eye calibration.

https://github.com/IFL-CAMP/easy_handeye: `parameters` and `transformation {x y z qx qy qz qw}`;
https://github.com/marcoesposito1988/easy_handeye2: `calibration_type` and `transform {translation, rotation}`. The
transformation is T_base_camera if the camera watches the robot, and T_effector_camera if it is on the hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from dextera_build.formats import camera_info
from dextera_build.geometry import poses

_QUATERNION = ("qw", "qx", "qy", "qz")
_KEYS = {
    "base": "robot_base_frame",
    "effector": "robot_effector_frame",
    "camera": "tracking_base_frame",
    "board": "tracking_marker_frame",
}
"""Name of a frame here -> in easy_handeye."""
_TYPES = {"eye_in_hand": True, "eye_on_base": False}


@dataclass(frozen=True)
class HandEye:
    """The content of such a file.

    Args:
        in_hand: Whether the camera is on the hand.
        frames: `base`, `effector`, `camera`, `board` -> name of the frame.
        pose: T_effector_camera or T_base_camera, (4, 4) [m].
        more: Further fields of the file, which easy_handeye does not read.
    """

    in_hand: bool
    frames: Mapping[str, str]
    pose: np.ndarray
    more: Mapping[str, Any]


def written(found: HandEye) -> str:
    """The YAML text of easy_handeye, with the further fields at its end."""
    pose = poses.from_matrix(found.pose).tolist()
    # easy_handeye rejects unknown parameters, and requires these.
    parameters = {
        "namespace": "/dxb/",
        "move_group_namespace": "/",
        "move_group": "manipulator",
        "eye_on_hand": found.in_hand,
    }
    fields = {
        "parameters": parameters | {theirs: found.frames[ours] for ours, theirs in _KEYS.items()},
        "transformation": dict(zip(("x", "y", "z", *_QUATERNION), pose, strict=True)),
    }
    return yaml.safe_dump({**fields, **found.more}, sort_keys=False, default_flow_style=None, width=120)


def read(text: str) -> HandEye:
    """The content of a file of either package.

    Raises:
        ValueError: It is no such file.
    """
    facts = camera_info.parsed(text)
    parameters = facts.get("parameters", facts)  # early versions of easy_handeye had them at the top level
    if not isinstance(parameters, Mapping):
        raise ValueError("its `parameters` hold no mapping")
    in_hand = parameters.get("eye_on_hand", _TYPES.get(str(parameters.get("calibration_type"))))
    if not isinstance(in_hand, bool):
        raise ValueError("it has neither `eye_on_hand: true|false` nor `calibration_type: eye_in_hand|eye_on_base`")
    frames = {ours: str(parameters.get(theirs) or ours) for ours, theirs in _KEYS.items()}
    known = {"parameters", "transformation", "transform", "eye_on_hand", "calibration_type", *_KEYS.values()}
    more = {str(name): value for name, value in facts.items() if name not in known}
    return HandEye(in_hand, frames, poses.to_matrix(_transformation(facts)), more)


def _transformation(facts: Mapping[str, Any]) -> np.ndarray:
    """Pose (7,), position and quaternion w x y z."""
    flat = facts.get("transformation")
    if isinstance(flat, Mapping):
        numbers = [flat.get(name) for name in ("x", "y", "z", *_QUATERNION)]
    else:
        parts = facts.get("transform")
        place, turn = (
            (parts.get(name) if isinstance(parts, Mapping) else None) for name in ("translation", "rotation")
        )
        if not isinstance(place, Mapping) or not isinstance(turn, Mapping):
            raise ValueError("it has neither `transformation` nor `transform` with `translation` and `rotation`")
        numbers = [place.get(name) for name in "xyz"] + [turn.get(name) for name in "wxyz"]
    pose = np.array(camera_info.numbers(numbers, "transformation", 7))
    length = float(np.linalg.norm(pose[3:]))
    if abs(length - 1) > 0.01:
        raise ValueError(f"its quaternion has length {length:.4g} instead of 1")
    return pose
