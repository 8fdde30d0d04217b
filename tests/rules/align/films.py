"""Films of textured shapes that move over a textured ground, with the true masks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dextera_build.artifacts.cameras.video import Video
from dextera_build.formats import video as video_files

HEIGHT, WIDTH, SIDE = 192, 256, 96
Way = Callable[[int], tuple[float, float, float]]
"""Number of a frame -> column and row of the centre [px], and angle [deg]."""


@dataclass(frozen=True)
class Shape:
    """A shape with a texture, moving in the plane of the picture."""

    mask: np.ndarray
    """(SIDE, SIDE) float32."""
    texture: np.ndarray
    """(SIDE, SIDE, 3) float32."""
    way: Way


def texture(seed: int, height: int, width: int, colour: tuple[float, float, float]) -> np.ndarray:
    """Coarse and fine noise around a colour, (height, width, 3) float32."""
    random = np.random.default_rng(seed)
    noise = [
        strength * cv2.resize(random.normal(size=(height // cell, width // cell, 3)), (width, height), interpolation=2)
        for cell, strength in ((4, 35.0), (12, 25.0))
    ]
    return np.clip(sum(noise) + np.array(colour), 0, 255).astype(np.float32)


def disc(seed: int, colour: tuple[float, float, float], way: Way) -> Shape:
    """An ellipse of 62 x 52 px."""
    rows, columns = np.indices((SIDE, SIDE)) - (SIDE - 1) / 2
    return Shape(
        ((columns / 31) ** 2 + (rows / 26) ** 2 < 1).astype(np.float32), texture(seed, SIDE, SIDE, colour), way
    )


def box(seed: int, colour: tuple[float, float, float], way: Way) -> Shape:
    """A rectangle of 52 x 40 px."""
    rows, columns = np.abs(np.indices((SIDE, SIDE)) - (SIDE - 1) / 2)
    return Shape(((columns < 26) & (rows < 20)).astype(np.float32), texture(seed, SIDE, SIDE, colour), way)


def film(
    path: Path, count: int, shapes: Sequence[Shape], hand: Shape | None = None, dimming: float = 0.0
) -> tuple[Video, np.ndarray]:
    """A video of 30 frames per second and the true labels (N, H, W) uint8.

    Args:
        path: The file to write.
        count: Number of frames.
        shapes: Label 1, 2, ...; the first is nearest.
        hand: What is nearer than all of them, and has no label.
        dimming: By how much the light falls until the end, 0..1.
    """
    ground, random = texture(99, HEIGHT, WIDTH, (110, 115, 120)), np.random.default_rng(0)
    frames, labels = [], np.zeros((count, HEIGHT, WIDTH), np.uint8)
    for number in range(count):
        pixels = ground
        for label, shape in [*reversed(list(enumerate(shapes, 1))), *([(0, hand)] if hand else [])]:
            column, row, angle = shape.way(number)
            motion = cv2.getRotationMatrix2D(((SIDE - 1) / 2, (SIDE - 1) / 2), angle, 1.0)
            motion[:, 2] += (column - (SIDE - 1) / 2, row - (SIDE - 1) / 2)
            mask = cv2.warpAffine(shape.mask, motion, (WIDTH, HEIGHT))
            drawn = cv2.warpAffine(shape.texture, motion, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
            pixels = pixels + mask[..., None] * (drawn - pixels)
            labels[number][mask > 0.5] = label
        noisy = pixels * (1 - dimming * number / count) + random.normal(0, 2, pixels.shape)
        frames.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return video_files.write(path, frames, video_files.encoder(WIDTH, HEIGHT, 30.0, qp=20)), labels


def iou(found: np.ndarray, true: np.ndarray, label: int) -> np.ndarray:
    """Intersection over union of a label per frame, (N,); NaN where neither has it."""
    both = ((found == label) & (true == label)).sum(axis=(1, 2))
    either = ((found == label) | (true == label)).sum(axis=(1, 2))
    return np.where(either > 0, both / np.maximum(either, 1), np.nan)
