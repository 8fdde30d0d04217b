"""Colour and depth pictures over time, with a ZIP archive of pictures as file format."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact, File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.packed import DAY
from dextera_build.artifacts.spatial.pose import check_rigid
from dextera_build.errors import ArtifactError

FORM = "ZIP of an RGB-D video"
_SATURATED = 65535
"""Counts that many drivers write for missing returns."""
DAMAGE = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, SyntaxError, ArithmeticError),
    *(zlib.error, zipfile.BadZipFile),
)


@dataclass(frozen=True)
class RgbdFrame:
    """One frame, from a depth camera or from a file."""

    stamp: float
    """Time [s]."""
    rgb: np.ndarray
    """(H, W, 3) uint8 sRGB."""
    depth: np.ndarray
    """(H, W) float32 image-plane z [m], registered to `rgb`; 0 where nothing was measured."""
    pose: np.ndarray | None = None
    """T_frame_camera (4, 4), if known."""


class RgbdVideo(Artifact):
    """Video of an RGB-D camera. Frames are decoded on access."""

    file: File
    """ZIP archive of `00000.png` or `00000.jpg`, and `00000.depth.png` with counts of 16 bit, for each frame."""
    camera: Camera
    """Intrinsics of colour and depth, which have the same pixels."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Time of each frame, increasing."""
    depth_scale_m: float = Field(0.001, gt=0.0)
    """Metres per count of a depth picture."""
    poses: Annotated[np.ndarray, Array("N 4 4", "float64", unit="m", frame="frame")] | None = None
    """T_frame_camera of each frame, OpenCV axes; None if the camera's motion is unknown, or if it is static."""
    frame: str = Field("world", pattern=r"^[ -~]+$")
    """Frame of the poses."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.stamps) or (np.diff(self.stamps) <= 0).any():
            raise ArtifactError(
                "RgbdVideo: it has no frame, or its times do not increase",
                code="DXB-A545",
                hint="sort the frames by time, and leave out those with equal stamps",
            )
        if self.poses is not None and len(self.poses) != len(self.stamps):
            raise ArtifactError(f"RgbdVideo: {len(self.poses)} poses for {len(self.stamps)} frames", code="DXB-A546")
        for number, pose in enumerate(() if self.poses is None else self.poses):
            check_rigid(f"the pose of frame {number}", pose)
        return self

    @classmethod
    def write(
        cls, path: str | Path, camera: Camera, frames: Iterable[RgbdFrame], *, depth_scale_m: float = 0.0002
    ) -> RgbdVideo:
        """Encode frames with lossless colour, one by one, into the `.zip` file `path`, and open it.

        Args:
            path: The file.
            camera: Intrinsics.
            frames: In order of time; poses of all or of none.
            depth_scale_m: Metres per count; depth above 65534 counts is dropped.

        Raises:
            ArtifactError: There is no frame, or one is not of the camera's size.
        """

        def encoded() -> Iterator[tuple[RgbdFrame, str, bytes, bytes]]:
            for frame in frames:
                counts = np.round(frame.depth / depth_scale_m)
                kept = np.where((counts > 0) & (counts < _SATURATED), counts, 0).astype(np.uint16)
                yield frame, ".png", png(frame.rgb), png(kept)

        return cls._packed(path, camera, encoded(), depth_scale_m, "world")

    @classmethod
    def pack(
        cls,
        path: str | Path,
        camera: Camera,
        frames: Iterable[tuple[float, str, bytes, bytes, np.ndarray | None]],
        *,
        depth_scale_m: float,
        frame: str = "world",
    ) -> RgbdVideo:
        """Collect picture files unchanged into the `.zip` file `path`, and open it.

        Args:
            path: The file.
            camera: Intrinsics.
            frames: Time [s], suffix (`.png` or `.jpg`) and bytes of the colour picture, bytes of the depth PNG, and
                T_frame_camera (4, 4) or None.
            depth_scale_m: Metres per count.
            frame: Frame of the poses.

        Raises:
            ArtifactError: There is no frame, or a picture is damaged or not of the camera's size.
        """

        def checked() -> Iterator[tuple[RgbdFrame, str, bytes, bytes]]:
            for stamp, suffix, rgb, depth, pose in frames:
                seen = RgbdFrame(stamp, _colour(rgb), _depth(depth, depth_scale_m), pose)
                yield seen, suffix, rgb, depth

        try:
            return cls._packed(path, camera, checked(), depth_scale_m, frame)
        except DAMAGE as error:
            raise unreadable(path, "PNG or JPEG", error) from None

    @classmethod
    def _packed(
        cls,
        path: str | Path,
        camera: Camera,
        frames: Iterator[tuple[RgbdFrame, str, bytes, bytes]],
        scale: float,
        parent: str,
    ) -> RgbdVideo:
        stamps: list[float] = []
        poses: list[np.ndarray] = []
        with zipfile.ZipFile(path, "w") as archive:
            for number, (frame, suffix, rgb, depth) in enumerate(frames):
                _check_size(number, camera, frame)
                archive.writestr(zipfile.ZipInfo(f"{number:05d}{suffix}", DAY), rgb)
                archive.writestr(zipfile.ZipInfo(f"{number:05d}.depth.png", DAY), depth)
                stamps.append(frame.stamp)
                poses += [] if frame.pose is None else [frame.pose]
        return cls(
            file=File.of(path),
            camera=camera,
            stamps=np.array(stamps, np.float64),
            depth_scale_m=scale,
            poses=np.array(poses, np.float64) if poses else None,
            frame=parent,
        )

    def frames(self, numbers: Iterable[int] | None = None) -> Iterator[RgbdFrame]:
        """Frames by number, or all of them in order, one at a time.

        Raises:
            ArtifactError: There is no such frame, or the archive is damaged.
        """
        with self.file.open() as raw:
            try:
                archive = zipfile.ZipFile(raw)
                members = {name.split(".")[0]: name for name in archive.namelist() if not name.endswith("depth.png")}
                for number in range(len(self.stamps)) if numbers is None else numbers:
                    name = members[f"{number:05d}"]
                    depth = _depth(archive.read(f"{number:05d}.depth.png"), self.depth_scale_m)
                    pose = None if self.poses is None else self.poses[number]
                    found = RgbdFrame(float(self.stamps[number]), _colour(archive.read(name)), depth, pose)
                    _check_size(number, self.camera, found)
                    yield found
            except (*DAMAGE, IndexError) as error:
                raise unreadable("rgbd.zip", FORM, error) from None


def _check_size(number: int, camera: Camera, frame: RgbdFrame) -> None:
    size = (camera.height, camera.width)
    if frame.rgb.shape[:2] != size or frame.depth.shape != size:
        colour, depth = (" x ".join(map(str, each.shape[1::-1])) for each in (frame.rgb, frame.depth))
        raise ArtifactError(
            f"frame {number} of an RgbdVideo does not have the size of its camera",
            code="DXB-A547",
            facts={"colour": f"{colour} px", "depth": f"{depth} px", "camera": f"{camera.width} x {camera.height} px"},
            hint="register the depth to the colour camera, and write the intrinsics of this resolution",
        )


def _colour(data: bytes) -> np.ndarray:
    from PIL import Image as Pillow

    with Pillow.open(io.BytesIO(data), formats=("PNG", "JPEG")) as picture:
        return np.asarray(picture.convert("RGB"))


def _depth(data: bytes, scale: float) -> np.ndarray:
    from PIL import Image as Pillow

    with Pillow.open(io.BytesIO(data), formats=("PNG",)) as picture:
        counts = np.asarray(picture)
    if counts.ndim != 2 or counts.dtype.kind not in "ui":
        raise ValueError(f"a depth picture has samples of {counts.dtype} in {counts.ndim} dimensions, not one count")
    return np.where((counts > 0) & (counts < _SATURATED), counts * np.float32(scale), 0).astype(np.float32)
