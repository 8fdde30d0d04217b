"""Training curves, for the report."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

WIDTH, HEIGHT = 640, 280
LEFT, RIGHT, TOP, BOTTOM = 60, WIDTH - 20, 28, HEIGHT - 34
INK, SOFT = (40, 44, 52), (222, 226, 231)
COLOURS = ((36, 99, 170), (200, 90, 30), (46, 125, 70))


def draw(curves: Mapping[str, tuple[np.ndarray, np.ndarray]], what: str, *, logarithmic: bool = True) -> np.ndarray:
    """Draw curves over optimiser steps, (280, 640, 3) uint8.

    Args:
        curves: Name -> (steps, values); empty ones are omitted.
        what: Name of the values.
        logarithmic: Whether the vertical axis is logarithmic; only if all values are positive.
    """
    from PIL import Image
    from PIL import ImageDraw as Draw

    shown = {name: pair for name, pair in curves.items() if len(pair[0])}
    values = np.concatenate([np.asarray(pair[1], np.float64) for pair in shown.values()])
    logarithmic = logarithmic and bool((values > 0).all())
    low, high = float(values.min()), float(values.max())
    high = high if high > low else low + max(abs(low), 1e-6) * 0.1
    last = max(float(pair[0][-1]) for pair in shown.values())
    picture = Image.new("RGB", (WIDTH, HEIGHT), (255, 255, 255))
    pen = Draw.Draw(picture)
    pen.text((LEFT, 8), what, fill=INK)
    for value in _ticks(low, high, logarithmic):
        y = float(_height(np.array([value]), low, high, logarithmic)[0])
        pen.line([(LEFT, y), (RIGHT, y)], fill=SOFT)
        pen.text((8, y - 6), f"{value:.3g}", fill=INK)
    for share in (0.0, 0.5, 1.0):
        pen.text((LEFT + share * (RIGHT - LEFT - 40), BOTTOM + 10), f"{share * last:,.0f}", fill=INK)
    for number, (name, (steps, curve)) in enumerate(shown.items()):
        xs = LEFT + np.asarray(steps, np.float64) / max(last, 1.0) * (RIGHT - LEFT)
        ys = _height(np.asarray(curve, np.float64), low, high, logarithmic)
        points = [(float(x), float(y)) for x, y in zip(xs, ys, strict=True)]
        pen.line(points if len(points) > 1 else points * 2, fill=COLOURS[number % 3], width=2)
        pen.text((RIGHT - 90 * (len(shown) - number), 8), name, fill=COLOURS[number % 3])
    return np.array(picture, np.uint8)


def _height(values: np.ndarray, low: float, high: float, logarithmic: bool) -> np.ndarray:
    """Map values to image rows, lowest at the bottom [px]."""
    scaled = np.log(values / low) / np.log(high / low) if logarithmic else (values - low) / (high - low)
    return np.asarray(BOTTOM - scaled * (BOTTOM - TOP))


def _ticks(low: float, high: float, logarithmic: bool) -> np.ndarray:
    return np.geomspace(low, high, 5) if logarithmic else np.linspace(low, high, 5)
