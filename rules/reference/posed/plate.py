"""A calibration board as a textured plate, as printed and mounted on an aluminium sheet."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.scenes.world import Part
from dextera_build.artifacts.shapes.mesh import Mesh

DOT_M = 0.0004
"""Side of a pixel of the texture [m]."""
BORDER_M = 0.012
"""Width of the white border around the markers [m]."""
THICK_M = 0.003
"""Thickness of the plate [m]."""


def size(board: Board) -> tuple[float, float]:
    """Width and height of the printed area of a grid of markers [m]."""
    gap = board.square_m - board.marker_m
    return board.columns * board.square_m - gap, board.rows * board.square_m - gap


def texture(board: Board) -> np.ndarray:
    """A grid of markers with its border, (H, W, 3) uint8; rows from the top."""
    import cv2

    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    width, height = (round((side + 2 * BORDER_M) / DOT_M) for side in size(board))
    sheet = np.full((height, width), 245, np.uint8)
    side = round(board.marker_m / DOT_M)
    for number in range(board.columns * board.rows):
        row, column = divmod(number, board.columns)
        top, left = (round((BORDER_M + index * board.square_m) / DOT_M) for index in (row, column))
        ink = cv2.aruco.generateImageMarker(family, number, side)
        sheet[top : top + side, left : left + side] = np.where(ink > 127, 245, 12)
    return np.repeat(sheet[..., None], 3, axis=2)


def part(board: Board, pixels: np.ndarray) -> Part:
    """The plate, its front on z = 0 of the board's frame, its body behind it (z away from the viewer)."""
    (width, height), b, d = size(board), BORDER_M, THICK_M
    low, high = np.array([-b, -b, 0.0]), np.array([width + b, height + b, d])
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    vertices = np.where(bits, high, low).astype(np.float32)
    front = [[0, 2, 1], [1, 2, 3]]
    others = [
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ]
    faces = np.array([*front, *others], np.int32)
    place = (vertices - low) / (high - low)
    uv = np.stack([place[:, 0], 1.0 - place[:, 1]], axis=1)[faces]  # v is up, the board's y is down
    uv[2:] = 0.004  # the other sides show the paper's white
    return Part(mesh=Mesh(vertices=vertices, faces=faces, uv=uv.astype(np.float32), texture=Image(pixels=pixels)))


def corners(board: Board) -> np.ndarray:
    """(4, 3) corners of the printed area in the board's frame [m]."""
    width, height = size(board)
    return np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
