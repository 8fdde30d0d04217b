"""Registration of a photograph in a generated panorama."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry.lie import rotation

from .sphere import warped

COARSE_PX, FINE_PX = 96, 256
"""Panorama heights of the coarse and the fine search [px]."""
PITCH_DEG, YAW_DEG = 75.0, 24.0
"""Range of the search in both directions [deg]."""
ROUNDS = (6.0, 2.0, 0.5)
"""Step sizes of the search, the first over the whole range, the others around the best [deg]."""
ALIKE = 40.0
"""Largest difference of smoothed colours at which a pixel agrees, of 255."""


@dataclass(frozen=True)
class Found:
    """The registered orientation."""

    camera_from_panorama: np.ndarray  # (3, 3)
    correlation: float  # of grey values over the photograph, -1..1
    seen: np.ndarray  # (H, W) bool, pixels that agree


def register(panorama: np.ndarray, pixels: np.ndarray, camera: Camera, guess: np.ndarray) -> Found:
    """The rotation near `guess` with the best correlation between photograph and panorama.

    The pitch and the yaw are searched for; the roll is that of the guess, the field of view that of the camera.

    Args:
        panorama: (H, 2 H, 3) uint8.
        pixels: (h, w, 3) uint8, the photograph.
        camera: Its intrinsics [px].
        guess: (3, 3) R_camera_panorama.
    """
    pitch, yaw, reach = 0.0, 0.0, (PITCH_DEG, YAW_DEG)
    for number, step in enumerate(ROUNDS):
        rows = COARSE_PX if number == 0 else FINE_PX
        small = cv2.resize(panorama, (2 * rows, rows), interpolation=cv2.INTER_AREA)
        tries = [
            (pitch + up, yaw + side)
            for up in np.arange(-reach[0], reach[0] + 1e-9, step)
            for side in np.arange(-reach[1], reach[1] + 1e-9, step)
        ]
        scores = [_correlation(small, *warped(pixels, camera, _turned(guess, *each), rows)) for each in tries]
        (pitch, yaw), reach = tries[int(np.argmax(scores))], (step, step)
    turn = _turned(guess, pitch, yaw)
    picture, inside = warped(pixels, camera, turn, panorama.shape[0])
    sigma = panorama.shape[0] / 200.0
    soft = [cv2.GaussianBlur(each.astype(np.float32), (0, 0), sigma) for each in (panorama, picture)]
    # Near its border, the smoothed photograph mixes with missing pixels.
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), sigma)[..., None]
    same = np.abs(soft[0] - soft[1] / np.maximum(weight, 1e-3)).max(axis=-1) < ALIKE
    return Found(turn, float(max(scores)), np.asarray(inside & same))


def _turned(guess: np.ndarray, pitch: float, yaw: float) -> np.ndarray:
    """R_camera_panorama with the photograph `pitch` lower and `yaw` further right in the panorama [deg]."""
    about_x, about_y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return np.asarray(guess @ rotation(np.deg2rad(pitch) * about_x) @ rotation(np.deg2rad(-yaw) * about_y))


def _correlation(panorama: np.ndarray, picture: np.ndarray, inside: np.ndarray) -> float:
    """Normalised correlation of grey values inside; -1 where fewer than 20 pixels are."""
    if int(inside.sum()) < 20:
        return -1.0
    one, other = (each[inside].astype(np.float64).mean(axis=1) for each in (panorama, picture))
    one, other = one - one.mean(), other - other.mean()
    return float(one @ other / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-9))
