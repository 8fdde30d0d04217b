"""Pictures with their cameras and poses: COLMAP's text model and nerfstudio's `transforms.json`."""

from __future__ import annotations

import io
import math
import posixpath
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts import colmap, colmap_images, lens, nerfstudio
from dextera_build.artifacts.base import Array, Artifact, File
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.formats import unreadable, unwritable
from dextera_build.artifacts.image import png, smaller
from dextera_build.artifacts.intrinsics import Intrinsics
from dextera_build.artifacts.labels import check_paths
from dextera_build.artifacts.lens import BrownConrady, Equirectangular, KannalaBrandt, Lens
from dextera_build.artifacts.point_cloud import PointCloud
from dextera_build.artifacts.pose import Pose, check_rigid
from dextera_build.errors import ArtifactError, listing
from dextera_build.geometry.plot import COLOURS, Line, plot

_ERROR = "error"
"""Attribute of `Views.points` with COLMAP's mean reprojection error [px]."""
_FORMATS = ("PNG", "JPEG")
_TRANSFORMS = "transforms.json"


class Views(Artifact):
    """Pictures of one scene with known cameras and poses."""

    saves: ClassVar[tuple[str, ...]] = (".json",)

    images: dict[str, File]
    """Path -> PNG or JPEG file; read when it is used."""
    names: tuple[str, ...]
    """Keys of `images`, in the order of the pictures."""
    camera: tuple[str, ...]
    """Per picture: its key in `cameras`."""
    cameras: dict[str, Camera | BrownConrady | KannalaBrandt | Equirectangular]
    """Label -> intrinsics."""
    poses: Annotated[np.ndarray, Array("N 4 4", "float64", unit="m", frame="frame")]
    """T_frame_camera of each picture, OpenCV axes; of a reconstruction without a known scale in its own unit."""
    frame: str = Field("world", pattern=r"^[ -~]+$")
    """Frame of the poses."""
    points: PointCloud | None = None
    """Sparse points of the reconstruction, in `frame`."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_paths(self.name(), self.images)
        if sorted(self.names) != sorted(self.images) or not len(self.names) == len(self.camera) == len(self.poses):
            raise ArtifactError(
                "Views: every picture needs one name, one camera and one pose",
                code="DXB-A508",
                facts={
                    "pictures": len(self.images),
                    "names": f"{len(self.names)}, {len(set(self.names))} different",
                    "cameras": len(self.camera),
                    "poses": len(self.poses),
                },
            )
        unknown = sorted(set(self.camera) - set(self.cameras))
        if unknown:
            raise ArtifactError(
                f"Views: there is no camera `{unknown[0]}`", code="DXB-A509", facts={"cameras": listing(self.cameras)}
            )
        for name, pose in zip(self.names, self.poses, strict=True):
            check_rigid(f"the pose of `{name}`", pose)
        return self

    def lens(self, name: str) -> Lens:
        """The camera of a picture."""
        return self.cameras[self.camera[self.names.index(name)]]

    def pose(self, name: str) -> Pose:
        """T_frame_camera of a picture; the child frame is `camera`."""
        return Pose(parent=self.frame, child="camera", matrix=self.poses[self.names.index(name)].copy())

    def pixels(self, name: str) -> np.ndarray:
        """A picture, (H, W, 3) uint8 sRGB.

        Raises:
            ArtifactError: The file is no picture, or differs in size from its camera.
        """
        wanted = self.lens(name)
        pixels = _decoded(name, self.images[name])
        if pixels.shape[:2] != (wanted.height, wanted.width):
            raise ArtifactError(
                f"`{name}` does not have the size of its camera",
                code="DXB-A510",
                facts={
                    "picture": f"{pixels.shape[1]} x {pixels.shape[0]} px",
                    "camera": f"{wanted.width} x {wanted.height} px",
                },
                hint="write the intrinsics of this resolution; fx, fy, cx and cy scale with the image",
            )
        return pixels

    def facts(self) -> Iterator[str]:
        """Number of pictures, cameras and points, and the extent of the cameras' positions."""
        yield f"{len(self.names):,} pictures"
        yield f"{len(self.cameras)} cameras" if len(self.cameras) != 1 else "1 camera"
        if len(self.poses):
            yield " x ".join(f"{length:.2f}" for length in np.ptp(self.poses[:, :3, 3], axis=0)) + " m"
        if self.points is not None:
            yield f"{len(self.points.points):,} points"

    def picture(self) -> bytes:
        """The cameras from above (along -z of their frame), each with its viewing direction, and the first picture."""
        places, ahead = self.poses[:, :2, 3], self.poses[:, :2, 2]
        reach = 0.15 * float(np.ptp(places, axis=0).max(initial=0)) or 0.1
        rays = [Line(np.stack([place, place + reach * way])) for place, way in zip(places, ahead, strict=True)]
        map_of = plot([*rays, Line(places, COLOURS[1], dots=True)], "x [m]", "y [m]", equal=True)
        if not self.names:
            return png(map_of)
        first = smaller(self.pixels(self.names[0]), 320)[:240]
        beside = np.full((240, first.shape[1], 3), 255, np.uint8)
        beside[: len(first)] = first
        return png(np.hstack([map_of, beside]))

    def colmap(self) -> dict[str, str]:
        """Name -> text of COLMAP's `cameras.txt`, `images.txt` and `points3D.txt`, without observations.

        Raises:
            ArtifactError: The name of a picture contains a space.
        """
        numbers = {label: number for number, label in enumerate(sorted(self.cameras, key=_by_number), 1)}
        cameras = {number: self.cameras[label].intrinsics() for label, number in numbers.items()}
        rows = zip(self.names, self.camera, self.poses, strict=True)
        posed = [colmap_images.Posed(name, numbers[label], pose) for name, label, pose in rows]
        try:
            texts = {
                "cameras.txt": colmap.cameras_written(cameras),
                "images.txt": colmap_images.images_written(posed, self.frame),
            }
        except ValueError as error:
            raise unwritable(self.name(), "COLMAP", error) from None
        points = self.points or PointCloud(points=np.zeros((0, 3), np.float32))
        count = len(points.points)
        colours = np.full((count, 3), 128, np.uint8) if points.colours is None else points.colours
        errors = points.attributes.get(_ERROR, np.zeros(count, np.float32))
        return texts | {"points3D.txt": colmap_images.points_written(points.points, colours, errors)}

    def transforms(self) -> str:
        """The text of nerfstudio's `transforms.json`, with pictures below `images/`.

        Raises:
            ArtifactError: It has no model for a lens.
        """
        rows = zip(self.names, self.camera, self.poses, strict=True)
        frames = [nerfstudio.Frame(f"images/{n}", self.cameras[label].intrinsics(), pose) for n, label, pose in rows]
        try:
            return nerfstudio.written(frames, self.frame)
        except ValueError as error:
            raise unwritable(self.name(), _TRANSFORMS, error) from None

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write `stem/images/` and `stem/sparse/0/*.txt`, as COLMAP does, and `stem/transforms.json` if possible."""
        root = Path(folder) / stem
        model = root / "sparse" / "0"
        model.mkdir(parents=True, exist_ok=True)
        written = []
        for name, text in self.colmap().items():
            written.append(model / name)
            written[-1].write_text(text)
        try:
            text = self.transforms()
        except ArtifactError:
            text = ""
        if text:
            written.append(root / _TRANSFORMS)
            written[-1].write_text(text)
        return written + self._place(root)

    def _write(self, path: Path) -> list[Path]:
        path.write_text(self.transforms())
        return [path, *self._place(path.parent)]

    def _place(self, root: Path) -> list[Path]:
        for name in self.names:
            self.images[name].place(root / "images" / name)
        return [root / "images" / name for name in self.names]

    @classmethod
    def load(cls, path: str | Path) -> Views:
        """Read a `transforms.json`, or a folder with one or with a COLMAP text model, and its pictures.

        Raises:
            ArtifactError: There is neither, it is damaged, or a picture is missing.
        """
        path = Path(path)
        root = path if path.is_dir() else path.parent
        files = {each.relative_to(root).as_posix(): File.of(each) for each in root.rglob("*") if each.is_file()}
        return cls.parse(files, "" if path.is_dir() else path.name)

    @classmethod
    def parse(cls, files: Mapping[str, File], main: str = "") -> Views:
        """The views in a tree of files.

        Args:
            files: Relative path -> content.
            main: The `transforms.json`, or "" to search one and then a COLMAP model, the topmost first.

        Raises:
            ArtifactError: There is neither, it is damaged, or a picture is missing.
        """
        found = main or _topmost(files, lambda name: posixpath.basename(name) == _TRANSFORMS)
        if found:
            return cls(**_of_transforms(files, found))
        found = _topmost(files, lambda name: name.endswith("cameras.txt") and _beside(name, "images.txt") in files)
        if found:
            return cls(**_of_colmap(files, posixpath.dirname(found)))
        raise ArtifactError(
            "no pictures with poses are here",
            code="DXB-A511",
            facts={"wanted": f"`{_TRANSFORMS}`, or COLMAP's `cameras.txt` and `images.txt`", "here": listing(files)},
            hint="write a binary COLMAP model as text: `colmap model_converter --output_type TXT`",
        )


def encoded(pixels: np.ndarray) -> File:
    """A picture (H, W, 3) uint8 sRGB as a PNG file, for `Views.images`."""
    return File(data=png(pixels))


def _of_transforms(files: Mapping[str, File], main: str) -> dict[str, Any]:
    root = posixpath.dirname(main)
    try:
        frames, world = nerfstudio.read(files[main].data.decode())
    except ValueError as error:
        raise unreadable(main, _TRANSFORMS, error) from None
    images: dict[str, File] = {}
    labels: list[str] = []
    cameras: dict[str, Intrinsics] = {}
    for frame in frames:
        # The NeRF authors omit the suffix.
        place = _picture(
            files, frame.path, [posixpath.join(root, frame.path), posixpath.join(root, f"{frame.path}.png")]
        )
        name = posixpath.relpath(place, root or ".").removeprefix("images/")
        images[name] = files[place]
        known = frame.lens or _by_angle(name, files[place], frame.angle_x)
        labels.append(next((label for label, other in cameras.items() if other == known), str(len(cameras) + 1)))
        cameras[labels[-1]] = known
    return {
        "images": images,
        "names": tuple(images),
        "camera": tuple(labels),
        "cameras": {label: lens.of(known) for label, known in cameras.items()},
        "poses": np.array([frame.pose for frame in frames]).reshape(-1, 4, 4),
        "frame": world,
    }


def _of_colmap(files: Mapping[str, File], root: str) -> dict[str, Any]:
    cameras = _parsed(files, posixpath.join(root, "cameras.txt"), colmap.cameras_read)
    posed, world = _parsed(files, posixpath.join(root, "images.txt"), colmap_images.images_read)
    folders = [posixpath.normpath(posixpath.join(root, way, "images")) for way in ("", "..", "../..")]
    images = {
        image.name: files[_picture(files, image.name, [f"{f}/{image.name}" for f in folders] + [image.name])]
        for image in posed
    }
    points = None
    if posixpath.join(root, "points3D.txt") in files:
        places, colours, errors = _parsed(files, posixpath.join(root, "points3D.txt"), colmap_images.points_read)
        attributes = {_ERROR: errors.astype(np.float32)}
        points = PointCloud(points=places.astype(np.float32), colours=colours, attributes=attributes, frame=world)
    return {
        "images": images,
        "names": tuple(image.name for image in posed),
        "camera": tuple(str(image.camera) for image in posed),
        "cameras": {str(number): lens.of(known) for number, known in cameras.items()},
        "poses": np.array([image.pose for image in posed]).reshape(-1, 4, 4),
        "frame": world,
        "points": points,
    }


def _parsed(files: Mapping[str, File], path: str, read: Any) -> Any:
    try:
        return read(files[path].data.decode())
    except ValueError as error:
        raise unreadable(path, "COLMAP text", error) from None


def _picture(files: Mapping[str, File], name: str, places: list[str]) -> str:
    """The first path that is a file."""
    found = next((place for place in map(posixpath.normpath, places) if place in files), None)
    if found is None:
        raise ArtifactError(
            f"the picture `{name}` is missing",
            code="DXB-A512",
            facts={"here": listing(path for path in files if path.lower().endswith((".png", ".jpg", ".jpeg")))},
            hint="keep the pictures next to the file that names them, in the folder `images`",
        )
    return found


def _by_angle(name: str, image: File, angle_x: float) -> Intrinsics:
    """The camera of a picture with only a horizontal field of view [rad]."""
    height, width = _decoded(name, image).shape[:2]
    focal = width / 2 / math.tan(angle_x / 2)
    return Intrinsics("pinhole", width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2))


def _decoded(name: str, image: File) -> np.ndarray:
    from PIL import Image as Pillow

    try:
        with Pillow.open(io.BytesIO(image.data), formats=_FORMATS) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
        raise unreadable(name, "PNG or JPEG", error) from None


def _topmost(files: Mapping[str, File], chosen: Any) -> str:
    return min(filter(chosen, files), key=lambda name: (name.count("/"), name), default="")


def _beside(name: str, other: str) -> str:
    return posixpath.join(posixpath.dirname(name), other)


def _by_number(label: str) -> tuple[int, str]:
    return len(label), label
