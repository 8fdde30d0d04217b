"""Detected board in one picture, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sighting:
    """Corners of a board in one picture."""

    board: np.ndarray  # (J, 3) in the board's frame [m]
    pixels: np.ndarray  # (J, 2) [px]
    candidates: tuple[np.ndarray, ...]  # (4, 4) T_camera_board each: candidates from this picture alone, best first
    rms_px: float  # root mean square distance of the corners from those of the best candidate
    orders: tuple[np.ndarray, ...] = ()  # (J,) each: other orders of `pixels` that the pattern permits
    mirrored_px: float = float("inf")  # `rms_px` if the board were numbered from right to left
    marker: int | None = None  # number of the marker, where the board is a single one


@dataclass(frozen=True)
class Picture:
    """Result of the detector for one picture."""

    sighting: Sighting | None
    brightness: float  # mean, 0..255
    sharpness: float  # standard deviation of the Laplacian of the grey picture
    found: str = ""  # other detections: markers of another board

    def reason(self) -> str:
        """Reason why there is no sighting, with the evidence."""
        if self.found:
            return self.found
        if self.brightness < 20.0:
            return f"too dark: mean brightness {self.brightness:.0f} of 255"
        return f"no board: mean brightness {self.brightness:.0f} of 255, sharpness {self.sharpness:.1f}"
