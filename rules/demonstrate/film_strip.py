"""The preview of a film: frames of one episode, side by side."""

from __future__ import annotations

import numpy as np

GAP_PX = 2


def strip(pixels: np.ndarray, count: int) -> np.ndarray:
    """`count` evenly spaced frames of (T, H, W, 3) in two rows, including the first and the last."""
    chosen = pixels[np.unique(np.linspace(0, len(pixels) - 1, max(2, count)).round().astype(int))]
    columns = -(-len(chosen) // 2)
    _, height, width, _ = pixels.shape
    sheet = np.full((2 * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX, 3), 255, np.uint8)
    for number, frame in enumerate(chosen):
        row, column = divmod(number, columns)
        top, left = row * (height + GAP_PX), column * (width + GAP_PX)
        sheet[top : top + height, left : left + width] = frame
    return sheet
