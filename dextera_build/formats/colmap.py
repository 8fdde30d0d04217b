"""COLMAP's text model: `cameras.txt` (https://colmap.github.io/format.html and cameras.html).

COLMAP counts pixels from the corner of the image, so the centre of the first pixel is at 0.5; here it is at 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from dextera_build.formats.intrinsics import Intrinsics, Model

Row = tuple[int, list[str]]
"""Number of a line, from 1, and its words."""


class _Form(NamedTuple):
    size: int
    model: Model
    parts: Callable[[tuple[float, ...]], tuple[tuple[float, ...], tuple[float, ...]]]
    """Parameters -> (fx, fy, cx, cy) and coefficients."""


def _single(p: tuple[float, ...]) -> tuple[float, ...]:
    return p[0], p[0], p[1], p[2]


def _padded(k: tuple[float, ...], size: int) -> tuple[float, ...]:
    return (*k, *(size - len(k)) * [0.0])


_FORMS = {
    "SIMPLE_PINHOLE": _Form(3, "pinhole", lambda p: (_single(p), ())),
    "PINHOLE": _Form(4, "pinhole", lambda p: (p, ())),
    "SIMPLE_RADIAL": _Form(4, "brown_conrady", lambda p: (_single(p), _padded(p[3:], 8))),
    "RADIAL": _Form(5, "brown_conrady", lambda p: (_single(p), _padded(p[3:], 8))),
    "OPENCV": _Form(8, "brown_conrady", lambda p: (p[:4], _padded(p[4:], 8))),
    "FULL_OPENCV": _Form(12, "brown_conrady", lambda p: (p[:4], p[4:])),
    "SIMPLE_FISHEYE": _Form(3, "kannala_brandt", lambda p: (_single(p), 4 * (0.0,))),
    "FISHEYE": _Form(4, "kannala_brandt", lambda p: (p, 4 * (0.0,))),
    "SIMPLE_RADIAL_FISHEYE": _Form(4, "kannala_brandt", lambda p: (_single(p), _padded(p[3:], 4))),
    "RADIAL_FISHEYE": _Form(5, "kannala_brandt", lambda p: (_single(p), _padded(p[3:], 4))),
    "OPENCV_FISHEYE": _Form(8, "kannala_brandt", lambda p: (p[:4], p[4:])),
    "EQUIRECTANGULAR": _Form(2, "equirectangular", lambda p: ((0.0, 0.0, 0.0, 0.0), ())),
}
"""COLMAP's models with an equivalent lens."""


def cameras_written(cameras: Mapping[int, Intrinsics]) -> str:
    """`cameras.txt` of cameras by number."""
    lines = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    lines.append(f"# Number of cameras: {len(cameras)}")
    for number, lens in cameras.items():
        model, parameters = _parameters(lens)
        words = [str(number), model, str(lens.width), str(lens.height), *map(repr, parameters)]
        lines.append(" ".join(words))
    return "\n".join(lines) + "\n"


def cameras_read(text: str) -> dict[int, Intrinsics]:
    """Cameras by number in a `cameras.txt`.

    Raises:
        ValueError: A line is not a camera, or its model has no equivalent lens.
    """
    found: dict[int, Intrinsics] = {}
    for row in rows(text):
        number, lens = _camera(row)
        if number in found:
            raise ValueError(f"line {row[0]}: camera {number} is there twice")
        found[number] = lens
    return found


def rows(text: str) -> Iterator[Row]:
    """Lines that are neither empty nor comments, as words."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.split()


def whole(row: Row, index: int) -> int:
    """A whole number in a line.

    Raises:
        ValueError: It is no whole number.
    """
    try:
        return int(row[1][index])
    except (IndexError, ValueError):
        raise ValueError(f"line {row[0]}: word {index + 1} is no whole number") from None


def numbers(row: Row, first: int, count: int) -> tuple[float, ...]:
    """Finite numbers in a line.

    Raises:
        ValueError: There are fewer, or they are not finite numbers.
    """
    words = row[1][first : first + count]
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        raise ValueError(f"line {row[0]}: a word after {first} is no number") from None
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"line {row[0]}: {count} finite numbers are needed after word {first}")
    return found


def _camera(row: Row) -> tuple[int, Intrinsics]:
    line, words = row
    form = _FORMS.get(words[1]) if len(words) > 1 else None
    if form is None:
        raise ValueError(f"line {line}: the camera's model is not one of {', '.join(_FORMS)}")
    width, height = whole(row, 2), whole(row, 3)
    if width < 1 or height < 1:
        raise ValueError(f"line {line}: the image is {width} x {height} px")
    if len(words) != 4 + form.size:
        raise ValueError(f"line {line}: {words[1]} takes {form.size} parameters, but {len(words) - 4} are given")
    (fx, fy, cx, cy), k = form.parts(numbers(row, 4, form.size))
    centre = (0.0, 0.0) if form.model == "equirectangular" else (cx - 0.5, cy - 0.5)
    return whole(row, 0), Intrinsics(form.model, width, height, (fx, fy), centre, k)


def _parameters(lens: Intrinsics) -> tuple[str, tuple[float, ...]]:
    base, k = (*lens.focal, lens.centre[0] + 0.5, lens.centre[1] + 0.5), lens.coefficients
    if lens.model == "pinhole":
        return "PINHOLE", base
    if lens.model == "equirectangular":
        return "EQUIRECTANGULAR", (float(lens.width), float(lens.height))
    if lens.model == "kannala_brandt":
        return "OPENCV_FISHEYE", base + k
    return ("FULL_OPENCV", base + k) if any(k[4:]) else ("OPENCV", base + k[:4])
