"""A small picture of lines and dots with axes, for previews."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

COLOURS = ((46, 110, 180), (216, 92, 44), (70, 150, 80), (150, 100, 190), (120, 120, 120))
_SIZE = (320, 240)
_PAPER, _INK, _GRID = (255, 255, 255), (60, 60, 60), (225, 225, 225)
_LEFT, _TOP, _RIGHT, _BOTTOM = 46, 10, 8, 30


@dataclass(frozen=True)
class Line:
    """A polyline, or dots.

    Args:
        points: (N, 2); rows that are not finite leave a gap.
        colour: sRGB, 0..255.
        dots: Draw points instead of the lines between them.
    """

    points: np.ndarray
    colour: tuple[int, int, int] = COLOURS[0]
    dots: bool = False


def plot(lines: Sequence[Line], x: str, y: str, *, equal: bool = False) -> np.ndarray:
    """Lines over labelled axes, (240, 320, 3) uint8.

    Args:
        lines: The curves, the last on top.
        x: Label of the horizontal axis, `x [m]`.
        y: Label of the vertical axis, which points up.
        equal: One scale for both axes.
    """
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", _SIZE, _PAPER)
    pen = ImageDraw.Draw(picture)
    low, high = _limits([line.points for line in lines], equal=equal)
    inner = np.array([_SIZE[0] - _LEFT - _RIGHT, _SIZE[1] - _TOP - _BOTTOM], np.float64)

    def place(points: np.ndarray) -> np.ndarray:
        share = (points - low) / (high - low)
        return np.stack([_LEFT + share[:, 0] * inner[0], _TOP + (1 - share[:, 1]) * inner[1]], axis=1)

    for share in (0.0, 0.5, 1.0):
        value = low + share * (high - low)
        column, row = place(value[None])[0]
        pen.line([(column, _TOP), (column, _SIZE[1] - _BOTTOM)], fill=_GRID)
        pen.line([(_LEFT, row), (_SIZE[0] - _RIGHT, row)], fill=_GRID)
        across = f"{value[0] + 0.0:.3g}"
        left = min(column - 12, _SIZE[0] - 2 - pen.textlength(across))
        pen.text((left, _SIZE[1] - _BOTTOM + 3), across, fill=_INK)
        pen.text((4, row - 6 if share < 1 else row - 2), f"{value[1] + 0.0:.3g}", fill=_INK)
    pen.text((_SIZE[0] // 2 - 10, _SIZE[1] - 14), x, fill=_INK)
    pen.text((4, _TOP + inner[1] / 4), y, fill=_INK)
    for line in lines:
        _draw(pen, place(line.points), line)
    return np.asarray(picture)


def _draw(pen: object, places: np.ndarray, line: Line) -> None:
    from PIL import ImageDraw

    assert isinstance(pen, ImageDraw.ImageDraw)
    seen = np.isfinite(places).all(axis=1)
    if line.dots:
        for column, row in places[seen]:
            pen.ellipse([column - 2, row - 2, column + 2, row + 2], fill=line.colour)
        return
    for first, second, drawn in zip(places[:-1], places[1:], seen[:-1] & seen[1:], strict=True):
        if drawn:
            pen.line([*first, *second], fill=line.colour, width=2)


def _limits(groups: Sequence[np.ndarray], *, equal: bool) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (2,) of the finite points, with a margin."""
    points = np.concatenate([np.zeros((0, 2)), *groups])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.zeros(2), np.ones(2)
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-9 + 1e-3 * np.abs(points).max())
    if equal:
        scale = float((size / [_SIZE[0] - _LEFT - _RIGHT, _SIZE[1] - _TOP - _BOTTOM]).max())
        size = scale * np.array([_SIZE[0] - _LEFT - _RIGHT, _SIZE[1] - _TOP - _BOTTOM])
    middle = (low + high) / 2
    return middle - 0.55 * size, middle + 0.55 * size
