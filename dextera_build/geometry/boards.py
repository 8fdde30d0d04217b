"""Layout of calibration boards: positions of their corners in the board's own frame.

Frames as in OpenCV: that of a single marker is at its centre, x right, y up, z towards the viewer; that of a grid, of a
chessboard and of a ChArUco board is at the upper left (of a chessboard: at its first inner corner), x right, y down, z
away from the viewer. Markers of a grid are numbered row by row from 0.
"""

from __future__ import annotations

import numpy as np

MARKER = 0.5 * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
"""Corners of a marker of side 1 in its own frame: upper left, upper right, lower right, lower left."""


def marker(side_m: float) -> np.ndarray:
    """(4, 3) corners of a single marker [m]."""
    return MARKER * side_m


def markers(columns: int, rows: int, pitch_m: float, side_m: float) -> np.ndarray:
    """(columns * rows, 4, 3) corners of the markers of a grid [m], row by row."""
    one = (MARKER * [1.0, -1.0, 1.0] + [0.5, 0.5, 0.0]) * side_m
    places = [[pitch_m * column, pitch_m * row, 0.0] for row in range(rows) for column in range(columns)]
    return np.asarray(one + np.array(places)[:, None])


def circles(columns: int, rows: int, spacing_m: float, *, asymmetric: bool) -> np.ndarray:
    """(columns * rows, 3) centres of circles [m], row by row.

    In an asymmetric grid, rows are `spacing_m` apart, circles of one row twice that, and every second row begins
    `spacing_m` to the right, as OpenCV has it.
    """
    places = np.array([[column, row, 0.0] for row in range(rows) for column in range(columns)])
    if asymmetric:
        places[:, 0] = 2 * places[:, 0] + places[:, 1] % 2
    return np.asarray(spacing_m * places)


def corners(columns: int, rows: int, square_m: float) -> np.ndarray:
    """(columns * rows, 3) corners of a chessboard [m], row by row."""
    return np.array([[square_m * column, square_m * row, 0.0] for row in range(rows) for column in range(columns)])
