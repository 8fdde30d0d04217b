"""`RgbdVideo` as a ZIP archive of pictures with `meta.json`."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.rgbd_video import DAMAGE, FORM, RgbdVideo
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.packed import DAY
from dextera_build.formats.files import suffix_among

_META = "meta.json"
_MOST_BYTES = 1 << 26
"""Maximum size of one picture of a frame [bytes]."""


def save(video: RgbdVideo, path: Path) -> list[Path]:
    """The archive, with camera, times and poses in `meta.json`."""
    said = {
        "camera": video.camera.model_dump(),
        "stamps_s": video.stamps.tolist(),
        "depth_scale_m": video.depth_scale_m,
        "frame": video.frame,
    } | ({} if video.poses is None else {"T_frame_camera": video.poses.tolist()})
    with video.file.open() as raw, zipfile.ZipFile(raw) as archive, zipfile.ZipFile(path, "w") as target:
        for name in sorted(set(archive.namelist()) - {_META}):
            target.writestr(zipfile.ZipInfo(name, DAY), archive.read(name))
        target.writestr(zipfile.ZipInfo(_META, DAY), json.dumps(said) + "\n", zipfile.ZIP_DEFLATED)
    return [path]


def load(path: str | Path) -> RgbdVideo:
    """Open an archive written by `save`, which must no longer change.

    Raises:
        ArtifactError: It is no such archive.
    """
    suffix_among("RgbdVideo", Path(path), (".zip",))
    try:
        with zipfile.ZipFile(path) as archive:
            if any(each.file_size > _MOST_BYTES for each in archive.infolist()):
                raise ValueError("a file in it is larger than 64 MiB")
            said = json.loads(archive.read(_META))
        return RgbdVideo(
            file=File.of(path),
            camera=Camera(**said["camera"]),
            stamps=np.array(said["stamps_s"], np.float64),
            depth_scale_m=float(said["depth_scale_m"]),
            poses=np.array(said["T_frame_camera"], np.float64) if "T_frame_camera" in said else None,
            frame=said["frame"],
        )
    except DAMAGE as error:
        raise unreadable(path, FORM, error) from None
