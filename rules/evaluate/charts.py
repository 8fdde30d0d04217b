"""Success charts: bars with intervals, and scatter plots of one world against another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .panels import INK, PAPER, typeface

FRAME, FAINT, RULE = (120, 126, 136), (176, 182, 190), (226, 228, 232)
WORLDS = {
    "twin": (58, 110, 165),
    "twin, tracked": (28, 66, 110),
    "reference": (214, 120, 46),
    "reference, tracked": (150, 78, 22),
    "perturbed": (150, 104, 170),
    "perturbed, tracked": (98, 60, 116),
    "real, tracked": (70, 140, 90),
}
"""Colour of each kind of world, with and without tracked objects, the same in every chart."""
HUES = ((58, 110, 165), (214, 120, 46), (70, 140, 90), (170, 70, 90), (120, 90, 160), (110, 110, 110))


@dataclass(frozen=True)
class Bar:
    """One bar; values as fractions."""

    world: str
    """Kind of world."""
    value: float
    """Height."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""


@dataclass(frozen=True)
class Dot:
    """One point of a scatter plot; values as fractions."""

    series: str
    """Legend entry."""
    x: tuple[float, float, float]
    """Value and interval in the twin."""
    y: tuple[float, float, float]
    """Value and interval in the other world."""


def bars(groups: Mapping[str, Sequence[Bar]]) -> np.ndarray:
    """Draw groups of bars, (H, W, 3) uint8, each with its label below."""
    wide, pitch, height, left, top = 30, 26, 240, 52, 34
    # A letter of the labels is seven pixels wide.
    letters = [max(map(len, label.split("\n"))) for label in groups]
    widths = [
        max(116, 7 * count + 16, pitch * len(group) + wide)
        for count, group in zip(letters, groups.values(), strict=True)
    ]
    width = left + sum(widths) + 12
    picture, pen = _sheet(width, top + height + 56)
    _levels(pen, left, top, width - left - 12, height)
    x = float(left)
    for (label, group), room in zip(groups.items(), widths, strict=True):
        first = x + (room - pitch * len(group)) / 2
        for number, bar in enumerate(group):
            _bar(pen, first + number * pitch + 3, pitch - 6, top, height, bar)
        for line, text in enumerate(label.split("\n")):
            _centred(pen, x + room / 2, top + height + 8 + 18 * line, text, 12)
        x += room
    seen = dict.fromkeys(bar.world for group in groups.values() for bar in group)
    _legend(pen, {world: WORLDS.get(world, FRAME) for world in seen}, left)
    return np.array(picture, np.uint8)


def scatter(dots: Sequence[Dot], title: str) -> np.ndarray:
    """Draw one world against the twin, with intervals and the diagonal of equality, (H, W, 3) uint8."""
    side, left, top = 340, 56, 58
    picture, pen = _sheet(left + side + 24, top + side + 50)
    _levels(pen, left, top, side, side)
    for part in range(0, 101, 20):
        _centred(pen, left + side * part / 100, top + side + 6, str(part), 12)
    pen.line([left, top + side, left + side, top], fill=FRAME)
    hues = {name: HUES[number % len(HUES)] for number, name in enumerate(dict.fromkeys(dot.series for dot in dots))}
    for dot in dots:
        (x, x_low, x_high), (y, y_low, y_high) = dot.x, dot.y
        pen.line([left + side * x_low, top + side * (1 - y), left + side * x_high, top + side * (1 - y)], fill=FAINT)
        pen.line([left + side * x, top + side * (1 - y_low), left + side * x, top + side * (1 - y_high)], fill=FAINT)
    for dot in dots:
        x, y = left + side * dot.x[0], top + side * (1 - dot.y[0])
        pen.ellipse([x - 5, y - 5, x + 5, y + 5], fill=hues[dot.series], outline=PAPER)
    pen.text((left, 8), title, fill=INK, font=typeface(14))
    _legend(pen, hues, left, top=32)
    _centred(pen, left + side / 2, top + side + 26, "success in the twin [%]", 12)
    return np.array(picture, np.uint8)


def _sheet(width: int, height: int) -> tuple[Any, Any]:
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", (width, height), PAPER)
    return picture, ImageDraw.Draw(picture)


def _levels(pen: Any, left: float, top: float, width: float, height: float) -> None:
    """Draw labelled horizontal grid lines every 20 %."""
    for part in range(0, 101, 20):
        y = top + height * (1 - part / 100)
        pen.line([left, y, left + width, y], fill=RULE if part else FRAME)
        text = str(part)
        pen.text((left - 8 - pen.textlength(text, font=typeface(12)), y - 8), text, fill=INK, font=typeface(12))


def _bar(pen: Any, x: float, width: float, top: float, height: float, bar: Bar) -> None:
    bottom, middle = top + height, x + width / 2
    pen.rectangle([x, bottom - height * bar.value, x + width, bottom], fill=WORLDS.get(bar.world, FRAME))
    low, high = bottom - height * bar.low, bottom - height * bar.high
    pen.line([middle, low, middle, high], fill=INK)
    for y in (low, high):
        pen.line([middle - 4, y, middle + 4, y], fill=INK)


def _legend(pen: Any, colours: Mapping[str, tuple[int, int, int]], left: float, top: float = 8) -> None:
    x = left
    for name, colour in colours.items():
        pen.rectangle([x, top + 2, x + 12, top + 14], fill=colour)
        pen.text((x + 18, top), name, fill=INK, font=typeface(12))
        x += 34 + pen.textlength(name, font=typeface(12))


def _centred(pen: Any, x: float, y: float, text: str, size: int) -> None:
    pen.text((x - pen.textlength(text, font=typeface(size)) / 2, y), text, fill=INK, font=typeface(size))
