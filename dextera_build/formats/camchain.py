"""Kalibr's `camchain.yaml`, cameras that are fixed to one another (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).

Poses are `T_cam_imu`, camera from rig, or `T_cn_cnm1`, camera from the previous camera; pixel centres are integers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from dextera_build.formats import camera_info
from dextera_build.formats.intrinsics import Intrinsics
from dextera_build.geometry import transforms

_KEY = re.compile(r"cam(\d+)")
_TOPIC = re.compile(r"/([^/\s]+)/image_raw")
_DISTORTIONS = {"radtan": ("brown_conrady", 4, 8), "equidistant": ("kannala_brandt", 4, 4), "none": ("pinhole", 0, 0)}
"""Kalibr's name -> lens, number of coefficients in the file, and in `Intrinsics`."""


@dataclass(frozen=True)
class Mounted:
    """A camera of a rig.

    Args:
        label: Its name.
        lens: Its intrinsics.
        pose: T_rig_camera, (4, 4) [m].
        covariance: Of the pose, (6, 6), or None.
    """

    label: str
    lens: Intrinsics
    pose: np.ndarray
    covariance: np.ndarray | None = None


def written(cameras: list[Mounted]) -> str:
    """The YAML text; topics contain the labels, and covariances of T_rig_camera are an additional field.

    Raises:
        ValueError: Kalibr has no model for a lens.
    """
    fields = {}
    for number, camera in enumerate(cameras):
        lens, kind = camera.lens, _kind(camera.lens)
        fields[f"cam{number}"] = {
            "camera_model": "pinhole",
            "intrinsics": [*lens.focal, *lens.centre],
            "distortion_model": kind,
            "distortion_coeffs": list(lens.coefficients[:4]),
            "resolution": [lens.width, lens.height],
            "rostopic": f"/{camera.label}/image_raw",
            "T_cam_imu": transforms.invert(camera.pose).tolist(),
        }
        if camera.covariance is not None:
            fields[f"cam{number}"]["covariance"] = camera.covariance.tolist()
    return yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, width=120)


def read(text: str) -> list[Mounted]:
    """The cameras of a camchain; without `T_cam_imu` the rig is the first camera.

    Raises:
        ValueError: It is no such file, or a camera has no pose.
    """
    facts = camera_info.parsed(text)
    keys = sorted((key for key in facts if _KEY.fullmatch(str(key))), key=lambda key: int(str(key)[3:]))
    if not keys:
        raise ValueError("it has no field `cam0`")
    topics = [
        _TOPIC.fullmatch(str(facts[key].get("rostopic"))) if isinstance(facts[key], Mapping) else None for key in keys
    ]
    names = [topic[1] for topic in topics if topic]
    labels = names if len(set(names)) == len(keys) else list(map(str, keys))
    found: list[Mounted] = []
    for label, key in zip(labels, keys, strict=True):
        if not isinstance(facts[key], Mapping):
            raise ValueError(f"`{key}` holds no mapping")
        try:
            found.append(_camera(label, facts[key], found[-1].pose if found else None))
        except ValueError as error:
            raise ValueError(f"`{key}`: {error}") from None
    return found


def _camera(label: str, facts: Mapping[str, Any], before: np.ndarray | None) -> Mounted:
    if facts.get("camera_model") != "pinhole" or facts.get("distortion_model") not in _DISTORTIONS:
        given = f"{facts.get('camera_model')}, {facts.get('distortion_model')}"
        raise ValueError(f"its model ({given}) is not pinhole with one of {', '.join(_DISTORTIONS)}")
    model, count, size = _DISTORTIONS[str(facts["distortion_model"])]
    k = camera_info.numbers(facts.get("distortion_coeffs", ()), "distortion_coeffs", count)
    fx, fy, cx, cy = camera_info.numbers(facts.get("intrinsics"), "intrinsics", 4)
    width, height = camera_info.numbers(facts.get("resolution"), "resolution", 2)
    if not (width.is_integer() and height.is_integer() and width > 0 and height > 0):
        raise ValueError(f"the image is {width:g} x {height:g} px")
    lens = Intrinsics(model, int(width), int(height), (fx, fy), (cx, cy), (*k, *(size - count) * [0.0]))  # type: ignore[arg-type]
    spread = facts.get("covariance")
    covariance = None if spread is None else _matrix(spread, "covariance", 6)
    return Mounted(label, lens, _pose(facts, before), covariance)


def _pose(facts: Mapping[str, Any], before: np.ndarray | None) -> np.ndarray:
    if "T_cam_imu" in facts:
        return transforms.invert(_matrix(facts["T_cam_imu"], "T_cam_imu", 4))
    if before is None:
        return np.eye(4)
    if "T_cn_cnm1" not in facts:
        raise ValueError("it has neither `T_cam_imu` nor `T_cn_cnm1`")
    return np.asarray(before @ transforms.invert(_matrix(facts["T_cn_cnm1"], "T_cn_cnm1", 4)))


def _matrix(value: object, name: str, size: int) -> np.ndarray:
    return np.array(camera_info.numbers(value, name, size * size)).reshape(size, size)


def _kind(lens: Intrinsics) -> str:
    if lens.model == "equirectangular":
        raise ValueError("Kalibr has no model for equirectangular images")
    if lens.model == "brown_conrady" and any(lens.coefficients[4:]):
        raise ValueError("Kalibr's `radtan` has no place for k3 to k6")
    return {kind: name for name, (kind, _, _) in _DISTORTIONS.items()}[lens.model]
