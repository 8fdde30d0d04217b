"""Pictures drawn by NumPy: three shaded balls move over a textured table, with the noise of a sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

NOISES = 8
"""Number of different noise pictures, shown in turn."""


class Table:
    """A textured plane with moving balls, seen from above.

    Args:
        width: Width of a picture [px].
        height: Height of a picture [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        random = np.random.default_rng(0)
        coarse = random.uniform(0.5, 1.0, (height // 8 + 1, width // 8 + 1, 1))
        fine = np.kron(coarse, np.ones((8, 8, 1)))[:height, :width]
        ground = fine * [150, 120, 90] + random.uniform(-12, 12, (height, width, 1))
        self._noise = random.normal(0, 2.0, (NOISES, height, width, 1))
        self._grounds = np.clip(ground + self._noise, 0, 255).astype(np.uint8)

    def pictures(self, seed: int, count: int) -> Iterator[np.ndarray]:
        """Frames (H, W, 3) uint8 of one episode through one camera."""
        random = np.random.default_rng(seed)
        radii = (self.height / random.uniform(5, 9, 3)).astype(int)
        place, speed = random.uniform(0.2, 0.8, (3, 2)), random.uniform(-0.004, 0.004, (3, 2))
        balls = [self._ball(radius, random.uniform(60, 250, 3)) for radius in radii]
        for number in range(count):
            shown = self._grounds[number % NOISES].copy()
            for (looks, inside), radius, start, step in zip(balls, radii, place, speed, strict=True):
                top, left = ((start + number * step) % 1 * [self.height, self.width]).astype(int) - radius
                skip = slice(max(-top, 0), self.height - top), slice(max(-left, 0), self.width - left)
                part = shown[max(top, 0) : top + 2 * radius, max(left, 0) : left + 2 * radius]
                np.copyto(part, looks[number % NOISES][skip], where=inside[skip])
            yield shown

    def _ball(self, radius: int, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pictures (NOISES, 2 R, 2 R, 3) of a ball in parallel projection, lit from the upper left, and its mask."""
        y, x = (np.mgrid[: 2 * radius, : 2 * radius] + 0.5) / radius - 1
        inside = x * x + y * y < 1
        z = np.sqrt(np.where(inside, 1 - x * x - y * y, 0))
        light = np.clip(0.25 + 0.75 * (z - 0.4 * x - 0.4 * y) / 1.15, 0, 1)
        looks = light[..., None] * colour + self._noise[:, : 2 * radius, : 2 * radius]
        return np.clip(looks, 0, 255).astype(np.uint8), inside[..., None]
