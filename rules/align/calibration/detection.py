"""Corners of calibration boards by OpenCV's detectors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.geometry import boards, transforms

from . import edges
from .sighting import Picture, Sighting

LEAST_CORNERS = 4
LEAST_SIDE = 3
"""Smallest number of inner corners along a side of a chessboard that OpenCV looks for."""
FAMILIES = {"16h5": "16H5", "25h9": "25H9", "36h10": "36H10", "36h11": "36H11"}
"""Names of AprilTag families, and their names in OpenCV."""


def look(pixels: np.ndarray, k: np.ndarray, board: Board, refinement: str) -> Picture:
    """Detect the board in a picture.

    Args:
        pixels: (H, W, 3) uint8 sRGB.
        k: (3, 3) intrinsics [px].
        board: The board.
        refinement: Refinement of marker corners: `edges` or `subpixel`.

    Raises:
        ValueError: The board's description names no dictionary of OpenCV, or no size.
    """
    import cv2

    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    seen, found = _SEEKERS[board.kind](grey, board, refinement)
    sharpness = float(cv2.Laplacian(grey, cv2.CV_64F).std())
    single = board.kind in ("aruco", "apriltag") and board.columns * board.rows == 1
    sighting = None if seen is None else _posed(seen, k, single=single)
    return Picture(sighting, float(grey.mean()), sharpness, found)


@dataclass(frozen=True)
class _Seen:
    """Result of a detector."""

    board: np.ndarray  # (J, 3) [m]
    pixels: np.ndarray  # (J, 2)
    orders: tuple[np.ndarray, ...] = ()  # (J,) each: other possible orders of the pixels
    mirrored: np.ndarray | None = None  # (J, 3) corners of the mirrored board [m]
    marker: int | None = None  # number of a single marker


def _posed(seen: _Seen, k: np.ndarray, *, single: bool) -> Sighting:
    pixels, orders = seen.pixels, (np.arange(len(seen.pixels)), *seen.orders)
    found = [pose for order in orders for pose in poses(seen.board, pixels[order], k, single)]
    found.sort(key=lambda pair: pair[1])
    other = np.inf if seen.mirrored is None else min(rms for _, rms in poses(seen.mirrored, pixels, k, single))
    candidates = tuple(pose for pose, _ in found)
    return Sighting(seen.board, pixels, candidates, found[0][1], seen.orders, other, seen.marker)


def poses(corners: np.ndarray, pixels: np.ndarray, k: np.ndarray, single: bool) -> list[tuple[np.ndarray, float]]:
    """Poses T_camera_board (4, 4) of a planar target, at most two, with RMS [px] (Collins and Bartoli 2014).

    Args:
        corners: (J, 3) on z = 0 [m].
        pixels: (J, 2) [px].
        k: (3, 3) intrinsics [px].
        single: Whether the corners are those of one square marker.
    """
    import cv2

    flag = cv2.SOLVEPNP_IPPE_SQUARE if single else cv2.SOLVEPNP_IPPE
    _, turns, places, _ = cv2.solvePnPGeneric(corners, pixels.reshape(-1, 1, 2), k, None, flags=flag)
    found = []
    for turn, place in zip(turns, places, strict=True):
        turn, place = cv2.solvePnPRefineLM(corners, pixels, k, None, turn, place)
        projected, _ = cv2.projectPoints(corners, turn, place, k, None)
        rms = float(np.sqrt(((projected.reshape(-1, 2) - pixels) ** 2).sum(axis=1).mean()))
        if np.isfinite(place).all() and place[2] > 0:
            found.append((transforms.rigid(cv2.Rodrigues(turn)[0], place.reshape(3)), rms))
    return found or [(transforms.rigid(np.eye(3), np.array([0.0, 0.0, 1.0])), float("inf"))]


def _markers(grey: np.ndarray, board: Board, refinement: str) -> tuple[_Seen | None, str]:
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    family = dictionary(board)
    detector = cv2.aruco.ArucoDetector(family, parameters)
    quads, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        mirrored = detector.detectMarkers(np.ascontiguousarray(grey[:, ::-1]))[1]
        return None, "" if mirrored is None else "the picture is mirrored: markers are found only after a flip"
    corners = {int(number): quad.reshape(4, 2) for number, quad in zip(ids.ravel(), quads, strict=True)}
    if refinement == "edges":
        corners = {number: edges.meet(grey, quad, family.markerSize + 2) for number, quad in corners.items()}
    if board.columns * board.rows == 1:
        # The marker's number is not stated, so the largest one is used; the rule compares those of all pictures.
        number = max(corners, key=lambda each: cv2.contourArea(corners[each].astype(np.float32)))
        return _Seen(boards.marker(board.square_m), corners[number].astype(np.float64), marker=number), ""
    layout = boards.markers(board.columns, board.rows, board.square_m, board.marker_m)
    known = sorted(number for number in corners if number < len(layout))
    if not known:
        return None, f"markers {', '.join(map(str, sorted(corners)))}, of which none is on the board"
    pixels = np.concatenate([corners[number] for number in known]).astype(np.float64)
    flipped = [number - number % board.columns + board.columns - 1 - number % board.columns for number in known]
    mirrored = np.concatenate(list(layout[flipped]))
    return _Seen(np.concatenate(list(layout[known])), pixels, mirrored=mirrored), ""


def _chessboard(grey: np.ndarray, board: Board, refinement: str) -> tuple[_Seen | None, str]:
    import cv2

    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    there, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if not there:
        there, corners = cv2.findChessboardCorners(grey, size)
        if not there:
            return None, _partly(grey, size)
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
        corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), stop)
    pixels = corners.reshape(-1, 2).astype(np.float64)
    # A view from behind would mirror the order; only rotations are ambiguous in the pattern.
    return _Seen(boards.corners(*size, board.square_m), pixels, _rotations(*size)), ""


def _rotations(columns: int, rows: int) -> tuple[np.ndarray, ...]:
    """Orders (columns * rows,) of a regular grid turned by half a turn, and by quarters if it is square."""
    grid = np.arange(columns * rows).reshape(rows, columns)
    turns = (2, 1, 3) if columns == rows else (2,)
    return tuple(np.rot90(grid, turn).ravel() for turn in turns)


def _partly(grey: np.ndarray, size: tuple[int, int]) -> str:
    """What of a chessboard is seen, if not the whole."""
    import cv2

    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    for less in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)):
        part = size[0] - less[0], size[1] - less[1]
        if min(part) >= LEAST_SIDE and cv2.findChessboardCornersSB(grey, part, flags=flags)[0]:
            return (
                f"only {part[0]} x {part[1]} of its {size[0]} x {size[1]} inner corners are seen: the border of the "
                "picture or something in front cuts the board, which must be visible completely"
            )
    return ""


def _circles(grey: np.ndarray, board: Board, refinement: str) -> tuple[_Seen | None, str]:
    import cv2

    asymmetric = board.kind == "asymmetric_circles"
    size = (board.columns, board.rows)
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for how in (0, cv2.CALIB_CB_CLUSTERING):
        there, centres = cv2.findCirclesGrid(grey, size, flags=kind | how)
        if there:
            break
    else:
        return None, ""
    pixels = centres.reshape(-1, 2).astype(np.float64)
    rows = np.arange(len(pixels)).reshape(board.rows, board.columns)
    along, across = pixels[rows[0, -1]] - pixels[0], pixels[rows[-1, 0]] - pixels[0]
    if not asymmetric and along[0] * across[1] < along[1] * across[0]:  # numbered as if seen from behind
        pixels = pixels[rows[:, ::-1].ravel()]
    orders = _rotations(*size)
    if asymmetric:  # only half a turn maps it to itself, and with an odd number of rows none does
        orders = orders[: (board.rows + 1) % 2]
    return _Seen(boards.circles(*size, board.square_m, asymmetric=asymmetric), pixels, orders), ""


def _charuco(grey: np.ndarray, board: Board, refinement: str) -> tuple[_Seen | None, str]:
    import cv2

    best: tuple[np.ndarray, np.ndarray] | None = None
    markers = 0
    for legacy in (False, True):  # OpenCV before 4.6 began boards with an even number of rows with a white square
        pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, dictionary(board))
        pattern.setLegacyPattern(legacy)
        pixels, ids, _, numbers = cv2.aruco.CharucoDetector(pattern).detectBoard(grey)
        markers = max(markers, 0 if numbers is None else len(numbers))
        if ids is not None and (best is None or len(ids) > len(best[1])):
            best = pixels.reshape(-1, 2).astype(np.float64), ids.ravel()
    if best is None or len(best[1]) < LEAST_CORNERS:
        return None, f"{markers} markers but no corner of the board" if markers else ""
    width = board.columns - 1
    column, row = best[1] % width, best[1] // width
    corners = np.stack([column + 1.0, row + 1.0, np.zeros(len(row))], axis=1) * board.square_m
    if np.linalg.matrix_rank(corners[1:] - corners[0], tol=1e-6) < 2:
        return None, "only corners on one line"
    return _Seen(corners, best[0]), ""


def dictionary(board: Board) -> Any:
    """OpenCV's dictionary of a board's markers, with names such as `DICT_5X5_100`, `5X5_100`, `36h11`.

    Raises:
        ValueError: There is none of this name.
    """
    import cv2

    name = board.dictionary.strip() or ("36h11" if board.kind == "apriltag" else "")
    if board.kind == "apriltag":
        name = f"APRILTAG_{name.lower().removeprefix('dict_').removeprefix('apriltag_').removeprefix('tag')}"
    name = name if name.upper().startswith("DICT_") else f"DICT_{name}"
    number = getattr(cv2.aruco, name, None) or getattr(cv2.aruco, name.upper(), None)
    if number is None and name.upper() != "DICT_4X4_50":  # whose number is 0
        raise ValueError(f"OpenCV has no dictionary `{board.dictionary}`")
    return cv2.aruco.getPredefinedDictionary(number or 0)


_SEEKERS: dict[str, Callable[[np.ndarray, Board, str], tuple[_Seen | None, str]]] = {
    "aruco": _markers,
    "apriltag": _markers,
    "chessboard": _chessboard,
    "circles": _circles,
    "asymmetric_circles": _circles,
    "charuco": _charuco,
}
