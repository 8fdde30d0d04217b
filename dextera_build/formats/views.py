"""`Views` as the text model of COLMAP and the `transforms.json` of nerfstudio."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.views import Views, decoded
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import ArtifactError, listing
from dextera_build.formats import colmap as colmap_cameras
from dextera_build.formats import colmap_images, nerfstudio
from dextera_build.formats import lens as lens_files
from dextera_build.formats.files import unwritable
from dextera_build.formats.intrinsics import Intrinsics

_ERROR = "error"
"""Attribute of `Views.points` with COLMAP's mean reprojection error [px]."""
_TRANSFORMS = "transforms.json"


def colmap(views: Views) -> dict[str, str]:
    """Name -> text of COLMAP's `cameras.txt`, `images.txt` and `points3D.txt`, without observations.

    Raises:
        ArtifactError: The name of a picture contains a space.
    """
    numbers = {label: number for number, label in enumerate(sorted(views.cameras, key=_by_number), 1)}
    cameras = {number: lens_files.numbers(views.cameras[label]) for label, number in numbers.items()}
    rows = zip(views.names, views.camera, views.poses, strict=True)
    posed = [colmap_images.Posed(name, numbers[label], pose) for name, label, pose in rows]
    try:
        texts = {
            "cameras.txt": colmap_cameras.cameras_written(cameras),
            "images.txt": colmap_images.images_written(posed, views.frame),
        }
    except ValueError as error:
        raise unwritable(Views.name(), "COLMAP", error) from None
    points = views.points or PointCloud(points=np.zeros((0, 3), np.float32))
    count = len(points.points)
    colours = np.full((count, 3), 128, np.uint8) if points.colours is None else points.colours
    errors = points.attributes.get(_ERROR, np.zeros(count, np.float32))
    return texts | {"points3D.txt": colmap_images.points_written(points.points, colours, errors)}


def transforms(views: Views) -> str:
    """The text of nerfstudio's `transforms.json`, with pictures below `images/`.

    Raises:
        ArtifactError: It has no model for a lens.
    """
    rows = zip(views.names, views.camera, views.poses, strict=True)
    frames = [
        nerfstudio.Frame(f"images/{n}", lens_files.numbers(views.cameras[label]), pose) for n, label, pose in rows
    ]
    try:
        return nerfstudio.written(frames, views.frame)
    except ValueError as error:
        raise unwritable(Views.name(), _TRANSFORMS, error) from None


def export(views: Views, folder: Path, stem: str) -> list[Path]:
    """Write `stem/images/` and `stem/sparse/0/*.txt`, as COLMAP does, and `stem/transforms.json` if possible."""
    root = folder / stem
    model = root / "sparse" / "0"
    model.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in colmap(views).items():
        written.append(model / name)
        written[-1].write_text(text)
    try:
        text = transforms(views)
    except ArtifactError:
        text = ""
    if text:
        written.append(root / _TRANSFORMS)
        written[-1].write_text(text)
    return written + _place(views, root)


def save(views: Views, path: Path) -> list[Path]:
    """Write a `transforms.json` with its pictures beside it."""
    path.write_text(transforms(views))
    return [path, *_place(views, path.parent)]


def _place(views: Views, root: Path) -> list[Path]:
    for name in views.names:
        views.images[name].place(root / "images" / name)
    return [root / "images" / name for name in views.names]


def load(path: str | Path) -> Views:
    """Read a `transforms.json`, or a folder with one or with a COLMAP text model, and its pictures.

    Raises:
        ArtifactError: There is neither, it is damaged, or a picture is missing.
    """
    path = Path(path)
    root = path if path.is_dir() else path.parent
    files = {each.relative_to(root).as_posix(): File.of(each) for each in root.rglob("*") if each.is_file()}
    return parse(files, "" if path.is_dir() else path.name)


def parse(files: Mapping[str, File], main: str = "") -> Views:
    """The views in a tree of files.

    Args:
        files: Relative path -> content.
        main: The `transforms.json`, or "" to search one and then a COLMAP model, the topmost first.

    Raises:
        ArtifactError: There is neither, it is damaged, or a picture is missing.
    """
    found = main or _topmost(files, lambda name: posixpath.basename(name) == _TRANSFORMS)
    if found:
        return Views(**_of_transforms(files, found))
    found = _topmost(files, lambda name: name.endswith("cameras.txt") and _beside(name, "images.txt") in files)
    if found:
        return Views(**_of_colmap(files, posixpath.dirname(found)))
    raise ArtifactError(
        "no pictures with poses are here",
        code="DXB-A511",
        facts={"wanted": f"`{_TRANSFORMS}`, or COLMAP's `cameras.txt` and `images.txt`", "here": listing(files)},
        hint="write a binary COLMAP model as text: `colmap model_converter --output_type TXT`",
    )


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
        "cameras": {label: lens_files.of(known) for label, known in cameras.items()},
        "poses": np.array([frame.pose for frame in frames]).reshape(-1, 4, 4),
        "frame": world,
    }


def _of_colmap(files: Mapping[str, File], root: str) -> dict[str, Any]:
    cameras = _parsed(files, posixpath.join(root, "cameras.txt"), colmap_cameras.cameras_read)
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
        "cameras": {str(number): lens_files.of(known) for number, known in cameras.items()},
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
    height, width = decoded(name, image).shape[:2]
    focal = width / 2 / math.tan(angle_x / 2)
    return Intrinsics("pinhole", width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2))


def _topmost(files: Mapping[str, File], chosen: Any) -> str:
    return min(filter(chosen, files), key=lambda name: (name.count("/"), name), default="")


def _beside(name: str, other: str) -> str:
    return posixpath.join(posixpath.dirname(name), other)


def _by_number(label: str) -> tuple[int, str]:
    return len(label), label
