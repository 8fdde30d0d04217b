"""COLMAP's text model: `images.txt` and `points3D.txt` (https://colmap.github.io/format.html).

COLMAP stores camera from world; here poses are world from camera. Both use OpenCV's axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.formats import colmap
from dextera_build.geometry import poses, quaternions, transforms

_FRAME = "# frame "


@dataclass(frozen=True)
class Posed:
    """A line of `images.txt`.

    Args:
        name: Path of the picture, relative to the folder of images.
        camera: Number of its camera.
        pose: T_world_camera, (4, 4) [unit of the model].
    """

    name: str
    camera: int
    pose: np.ndarray


def images_written(images: Sequence[Posed], world: str) -> str:
    """`images.txt` without observations, which is the empty line after each image.

    Args:
        images: The images.
        world: Name of the frame of their poses, for a comment.

    Raises:
        ValueError: A name contains a space, at which COLMAP's readers truncate it.
    """
    lines = [
        f"{_FRAME}{world}",
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "#   POINTS2D[] as (X, Y, POINT3D_ID)",
        f"# Number of images: {len(images)}",
    ]
    for number, image in enumerate(images, 1):
        if image.name.split() != [image.name]:
            raise ValueError(f"the name `{image.name}` holds a space")
        pose = poses.from_matrix(transforms.invert(image.pose)).tolist()
        lines += [" ".join([str(number), *map(repr, pose[3:] + pose[:3]), str(image.camera), image.name]), ""]
    return "\n".join(lines) + "\n"


def images_read(text: str) -> tuple[list[Posed], str]:
    """The images of an `images.txt` in the order of their numbers, without observations, and the frame of their poses.

    Raises:
        ValueError: A line is not an image.
    """
    found = {}
    for row in _first_lines(text):
        line, words = row
        if len(words) < 10:
            raise ValueError(f"line {line}: an image has 10 words, but {len(words)} are given")
        number, numbers = colmap.whole(row, 0), np.array(colmap.numbers(row, 1, 7))
        if np.abs(np.linalg.norm(numbers[:4]) - 1) > 0.01:
            raise ValueError(f"line {line}: the quaternion has length {np.linalg.norm(numbers[:4]):.4g} instead of 1")
        pose = transforms.invert(transforms.rigid(quaternions.to_matrix(numbers[:4]), numbers[4:]))
        if number in found:
            raise ValueError(f"line {line}: image {number} is there twice")
        found[number] = Posed(words[9], colmap.whole(row, 8), pose)
    comments = (line.removeprefix(_FRAME) for line in text.splitlines() if line.startswith(_FRAME))
    return [found[number] for number in sorted(found)], next(comments, "world")


def points_written(points: np.ndarray, colours: np.ndarray, errors: np.ndarray) -> str:
    """`points3D.txt` without tracks.

    Args:
        points: (N, 3).
        colours: (N, 3) uint8.
        errors: (N,) mean reprojection errors [px].
    """
    lines = ["# 3D point list with one line of data per point:", "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"]
    lines.append(f"# Number of points: {len(points)}")
    rows = zip(points.tolist(), colours.tolist(), errors.tolist(), strict=True)
    for number, (point, colour, error) in enumerate(rows, 1):
        lines.append(" ".join([str(number), *map(repr, point), *map(str, colour), repr(error)]))
    return "\n".join(lines) + "\n"


def points_read(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) float64, colours (N, 3) uint8 and errors (N,) float64 of a `points3D.txt`; tracks are left out.

    Raises:
        ValueError: A line is not a point.
    """
    rows = [colmap.numbers(row, 1, 7) for row in colmap.rows(text)]
    table = np.array(rows, np.float64).reshape(-1, 7)
    if not ((table[:, 3:6] >= 0) & (table[:, 3:6] <= 255)).all():
        raise ValueError("a colour is not within 0..255")
    return table[:, :3], table[:, 3:6].astype(np.uint8), table[:, 6]


def _first_lines(text: str) -> Iterator[colmap.Row]:
    """The first line of each image; the second one, of observations, may be empty."""
    is_second = False
    for number, line in enumerate(text.splitlines(), 1):
        if is_second:
            is_second = False
        elif line.strip() and not line.lstrip().startswith("#"):
            yield number, line.split()
            is_second = True
