"""Quarter turns that make a picture upright, so that rows increase downwards in the scene."""

from __future__ import annotations

import numpy as np

Box = tuple[int, int, int, int]
"""left, top, right, bottom [px], right and bottom excluded."""


def turns(world_from_camera: np.ndarray) -> int:
    """Counter-clockwise quarter turns, 0 to 3, after which the world's x is nearest to image right.

    The world of a support has its x along the image right of the upright picture, see `Support`; unlike the direction
    of gravity, this is defined for a camera that looks straight down, too.

    Args:
        world_from_camera: T_world_camera (4, 4), camera in OpenCV axes.
    """
    right, down = float(world_from_camera[0, 0]), float(world_from_camera[0, 1])
    return int(np.argmax([right, down, -right, -down]))


def turned(picture: np.ndarray, count: int) -> np.ndarray:
    """A picture (H, W, ...) rotated counter-clockwise by `count` quarter turns; negative counts rotate back."""
    return np.ascontiguousarray(np.rot90(picture, count)) if count % 4 else picture


def turned_from_camera(count: int) -> np.ndarray:
    """T_turned_camera (4, 4): points of the camera in the frame of the camera that took the turned picture."""
    turn = np.eye(4)
    turn[:2, :2] = np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), count % 4)
    return turn


def turned_box(box: Box, size: tuple[int, int], count: int) -> Box:
    """The box in the picture turned by `count` quarter turns.

    Args:
        box: left, top, right, bottom [px] before the turn.
        size: Width and height of the picture before the turn [px].
        count: Counter-clockwise quarter turns; negative counts turn back.
    """
    for _ in range(count % 4):
        left, top, right, bottom = box
        box, size = (top, size[0] - right, bottom, size[0] - left), (size[1], size[0])
    return box
