"""A printable sheet with a calibration board, a bar to measure the printed scale, and a description."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.errors import ArtifactError, listing
from dextera_build.formats.pdf import PAPERS_MM, Rectangle, Text, page

EDGE_MM = 10.0
"""Margin that printers leave blank [mm]."""
FOOT_MM = 22.0
"""Height of the bar and the text below the board [mm]."""
BAR_MM = 100.0
"""Length of the bar [mm]."""
QUIET = 0.5
"""Width of the white border around the board, in squares, as detectors require."""


def target(board: Board) -> dict[str, object]:
    """`target` of a `capture.json` with this board."""
    if board.kind == "chessboard":
        return {"type": "chessboard", "inner_corners": [board.columns, board.rows], "square_m": board.square_m}
    if board.kind == "charuco":
        return {
            "type": "charuco",
            "squares": [board.columns, board.rows],
            "square_m": board.square_m,
            "marker_m": board.marker_m,
            "dictionary": board.dictionary,
        }
    side = board.marker_m or board.square_m
    found: dict[str, object] = {"type": board.kind, "dictionary": board.dictionary, "size_m": round(side, 6)}
    if board.columns * board.rows > 1:
        found |= {"markers": [board.columns, board.rows], "gap_m": round(board.square_m - side, 6)}
    return found


def size_mm(board: Board) -> tuple[float, float]:
    """Width and height of the pattern, without the white around it."""
    extra = 1 if board.kind == "chessboard" else 0
    gap = board.square_m - board.marker_m if board.kind in ("aruco", "apriltag") and board.marker_m else 0.0
    sides = (board.columns + extra, board.rows + extra)
    width, height = (1000 * (count * board.square_m - gap) for count in sides)
    return width, height


def pdf(board: Board, paper: str = "a4") -> bytes:
    """The sheet; the pattern is centred above the bar.

    Args:
        board: The board.
        paper: `a4`, `a3` or `letter`, upright or across as the board needs.

    Raises:
        ArtifactError: The board does not fit, or has more markers than its dictionary.
    """
    width, height = size_mm(board)
    sheet = _sheet(board, paper, width, height)
    left, top = (sheet[0] - width) / 2, (sheet[1] - FOOT_MM - height) / 2
    shapes = [
        [Rectangle(left + 1000 * x, top + 1000 * y, 1000 * w, 1000 * h) for x, y, w, h in group]
        for group in patterns(board)
    ]
    bar, texts = _foot(board, sheet)
    return page(sheet, [*shapes, bar], texts, _title(board))


def patterns(board: Board) -> list[list[tuple[float, float, float, float]]]:
    """Groups of black rectangles x, y, width, height [m]; x goes right and y down from the pattern's corner.

    Raises:
        ArtifactError: The dictionary is unknown, or has too few markers.
    """
    side = board.square_m
    if board.kind == "chessboard":
        cells = [(i, j) for j in range(board.rows + 1) for i in range(board.columns + 1) if (i + j) % 2 == 0]
        return [[(i * side, j * side, side, side) for i, j in cells]]
    import cv2

    dictionary = _dictionary(board)
    counts = (board.columns, board.rows)
    if counts == (1, 1):
        return [_marker(dictionary, 0, side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))]
    made: Any
    if board.kind == "charuco":
        made = cv2.aruco.CharucoBoard(counts, side, board.marker_m, dictionary)
    else:
        made = cv2.aruco.GridBoard(counts, board.marker_m, side - board.marker_m, dictionary)
    corners = [np.asarray(each, np.float64)[:, :2] for each in made.getObjPoints()]
    numbers = [int(each) for each in np.asarray(made.getIds()).ravel()]
    found = [_marker(dictionary, number, each) for number, each in zip(numbers, corners, strict=True)]
    if board.kind == "charuco":
        white = {tuple((each.mean(axis=0) // side).astype(int)) for each in corners}
        black = [(i, j) for j in range(board.rows) for i in range(board.columns) if (i, j) not in white]
        found.append([(i * side, j * side, side, side) for i, j in black])
    return found


def _marker(dictionary: Any, number: int, corners: np.ndarray) -> list[tuple[float, float, float, float]]:
    """Black cells of a marker, joined along rows."""
    import cv2

    count = dictionary.markerSize + 2
    dark = cv2.aruco.generateImageMarker(dictionary, number, count) == 0
    low, cell = corners.min(axis=0), float(np.ptp(corners[:, 0])) / count
    found = []
    for row in range(count):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], dark[row].astype(int), [0]])))
        for start, end in edges.reshape(-1, 2):
            found.append((low[0] + start * cell, low[1] + row * cell, (end - start) * cell, cell))
    return [tuple(float(value) for value in each) for each in found]  # type: ignore[misc]


def _dictionary(board: Board) -> Any:
    import cv2

    name = board.dictionary
    spelled = f"DICT_APRILTAG_{name}" if board.kind == "apriltag" and not name.startswith("DICT_") else name
    if not hasattr(cv2.aruco, spelled):
        known = [each for each in dir(cv2.aruco) if each.startswith("DICT_")]
        raise ArtifactError(
            f"no dictionary of markers is called `{name}`", code="DXB-A530", facts={"known": listing(known, most=40)}
        )
    found = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spelled))
    needed = board.columns * board.rows // (2 if board.kind == "charuco" else 1)
    if needed > len(found.bytesList):
        raise ArtifactError(
            f"the board needs {needed} markers, and `{name}` has {len(found.bytesList)}",
            code="DXB-A531",
            hint="take fewer columns and rows, or a larger dictionary",
        )
    return found


def _sheet(board: Board, paper: str, width: float, height: float) -> tuple[float, float]:
    if paper not in PAPERS_MM:
        raise ArtifactError(f"no paper is called `{paper}`", code="DXB-A532", facts={"papers": listing(PAPERS_MM)})
    quiet = 1000 * QUIET * (board.marker_m or board.square_m) if board.kind != "charuco" else 0.0
    upright = PAPERS_MM[paper]
    for sheet in (upright, upright[::-1]):
        room = (sheet[0] - 2 * EDGE_MM, sheet[1] - FOOT_MM - 2 * EDGE_MM)
        if width + quiet <= room[0] and height + quiet <= room[1]:
            return sheet
    raise ArtifactError(
        f"the board does not fit on {paper}",
        code="DXB-A532",
        facts={"board": f"{width:.0f} x {height:.0f} mm", "paper": f"{upright[0]:.0f} x {upright[1]:.0f} mm"},
        hint="smaller squares, fewer of them, or larger paper",
    )


def _title(board: Board) -> str:
    names = {"charuco": "ChArUco", "chessboard": "chessboard", "aruco": "ArUco", "apriltag": "AprilTag"}
    text = f"{names[board.kind]} {board.columns} x {board.rows}"
    if board.kind in ("aruco", "apriltag"):
        side = board.marker_m or board.square_m
        text += f", marker {1000 * side:g} mm"
        text += f", gap {1000 * (board.square_m - side):g} mm" if board.columns * board.rows > 1 else ""
    else:
        text += " inner corners" if board.kind == "chessboard" else " squares"
        text += f", square {1000 * board.square_m:g} mm"
        text += f", marker {1000 * board.marker_m:g} mm" if board.kind == "charuco" else ""
    return text + (f", {board.dictionary}" if board.dictionary else "")


def _foot(board: Board, sheet: tuple[float, float]) -> tuple[list[Rectangle], list[Text]]:
    """The bar, whose ends are at exactly 100 mm, with a tick each 10 mm; and three lines."""
    left, top = EDGE_MM, sheet[1] - FOOT_MM
    bar = [Rectangle(left, top + 2.0, BAR_MM, 0.3)]
    for number in range(11):
        high = 2.0 if number % 5 == 0 else 1.2
        # The outer edges of the first and the last tick are the ends of the bar.
        inset = {0: 0.0, 10: 0.3}.get(number, 0.15)
        bar.append(Rectangle(left + 10 * number - inset, top + 2.0 - high, 0.3, high))
    say = "This bar is 100 mm from outer edge to outer edge. If yours is not, print again at 100 %"
    lines = [say, _title(board) + ". Top is up.", f'"target": {json.dumps(target(board))}']
    texts = [Text(left + BAR_MM + 4.0, top + 2.3, 2.8, "100 mm")]
    texts += [Text(left, top + 5.6 + 3.4 * number, 2.5, line) for number, line in enumerate(lines)]
    return bar, texts
