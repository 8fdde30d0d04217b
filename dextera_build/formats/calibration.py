"""`Calibration` as the YAML of easy_handeye, with intrinsics beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml as yaml_files
from pydantic import ValidationError

from dextera_build.artifacts.cameras.calibration import SERIES, Board, Calibration
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.formats import camera_info, easy_handeye
from dextera_build.formats import lens as lens_files
from dextera_build.formats.files import suffix_among

_KINDS = ("chessboard", "charuco", "aruco", "apriltag", "circles", "asymmetric_circles")


def yaml(found: Calibration) -> str:
    """easy_handeye's YAML, with additional fields that easy_handeye ignores."""
    more: dict[str, Any] = {"calibration_method": found.method} if found.method else {}
    if found.pose.covariance is not None:
        more["covariance"] = found.pose.covariance.tolist()
    if found.pose.stamp is not None:
        more["stamp"] = found.pose.stamp
    if found.board is not None:
        more["board"] = found.board.model_dump()
    if found.board_pose is not None:
        spread = found.board_pose.covariance
        more["board_pose"] = {
            "matrix": found.board_pose.matrix.tolist(),
            "covariance": None if spread is None else spread.tolist(),
        }
    more |= {name: getattr(found, name).tolist() for name in SERIES if getattr(found, name) is not None}
    if found.camera is not None:
        more["camera_info"] = yaml_files.safe_load(
            camera_info.written(lens_files.numbers(found.camera), found.pose.child)
        )
    frames = {"base": found.base_frame, "effector": found.effector_frame, "board": found.board_frame}
    frames["camera"] = found.pose.child
    return easy_handeye.written(easy_handeye.HandEye(found.mount == "eye_in_hand", frames, found.pose.matrix, more))


def save(found: Calibration, path: Path) -> list[Path]:
    """Write YAML, and the intrinsics as a ROS camera_info beside it."""
    path.write_text(yaml(found))
    if found.camera is None:
        return [path]
    return [path, *lens_files.save(found.camera, path.with_name(f"{path.stem}.camera_info.yaml"))]


def load(path: str | Path) -> Calibration:
    """Read a file of easy_handeye or easy_handeye2, with intrinsics from `STEM.camera_info.yaml` if missing.

    Raises:
        ArtifactError: It is no such file.
    """
    path = Path(path)
    suffix_among("Calibration", path, (".yaml", ".yml", ".calib"))
    beside = path.with_name(f"{path.stem}.camera_info.yaml")
    return parse(path.read_bytes(), path, beside.read_bytes() if beside.is_file() else None)


def parse(data: bytes, path: str | Path, intrinsics: bytes | None = None) -> Calibration:
    """The calibration in the content of a file that is named `path`.

    Args:
        data: The content.
        path: The file, for messages.
        intrinsics: A ROS camera_info, for a file without intrinsics.

    Raises:
        ArtifactError: One of them is damaged.
    """
    try:
        fields = _fields(easy_handeye.read(data.decode()))
    except ValueError as error:
        raise unreadable(path, "easy_handeye YAML", error) from None
    if fields["camera"] is None and intrinsics is not None:
        fields["camera"] = lens_files.parse(intrinsics, Path("camera_info.yaml"))
    return Calibration(**fields)


def _fields(found: easy_handeye.HandEye) -> dict[str, Any]:
    frames, more = found.frames, found.more
    holder, other = ("effector", "base") if found.in_hand else ("base", "effector")
    known = more.get("camera_info")
    board_pose = more.get("board_pose")
    series = {name: _series(more, name) for name in SERIES}
    stamp = more.get("stamp")
    pose = Pose(
        parent=frames[holder],
        child=frames["camera"],
        matrix=found.pose,
        covariance=_square(more.get("covariance"), "covariance", 6),
        stamp=camera_info.numbers([stamp], "stamp", 1)[0] if stamp is not None else None,
    )
    return {
        "mount": "eye_in_hand" if found.in_hand else "eye_on_base",
        "pose": pose,
        "base_frame": frames["base"],
        "effector_frame": frames["effector"],
        "board_frame": frames["board"],
        "camera": lens_files.of(camera_info.of(known)) if isinstance(known, Mapping) else None,
        "method": str(more.get("calibration_method", "")),
        "board": _board(more.get("board")),
        "board_pose": _pose(board_pose, frames[other], frames["board"]) if isinstance(board_pose, Mapping) else None,
        **series,
    }


def _series(more: Mapping[str, Any], name: str) -> np.ndarray | None:
    value = more.get(name)
    if value is None:
        return None
    numbers = np.array(camera_info.numbers(value, name))
    if name == "reprojection_px":
        return numbers
    if len(numbers) % 2:
        raise ValueError(f"its {name} are not pairs of a distance and an angle")
    return numbers.reshape(-1, 2)


def _square(value: object, name: str, size: int) -> np.ndarray | None:
    return None if value is None else np.array(camera_info.numbers(value, name, size * size)).reshape(size, size)


def _pose(fields: Mapping[str, Any], parent: str, child: str) -> Pose:
    matrix = _square(fields.get("matrix", ()), "board_pose.matrix", 4)
    return Pose(
        parent=parent, child=child, matrix=matrix, covariance=_square(fields.get("covariance"), "covariance", 6)
    )


def _board(value: object) -> Board | None:
    if value is None:
        return None
    if not isinstance(value, Mapping) or value.get("kind") not in _KINDS:
        raise ValueError(f"the kind of its board is not one of {', '.join(_KINDS)}")
    try:
        return Board(**{str(name): each for name, each in value.items()})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"its board: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
