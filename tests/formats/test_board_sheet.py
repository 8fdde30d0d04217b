"""Sheets to print: OpenCV finds the board on the page, at its true size."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.errors import ArtifactError
from dextera_build.formats import board_sheet

DPI = 150
CHARUCO = Board(kind="charuco", columns=7, rows=5, square_m=0.033, marker_m=0.024, dictionary="DICT_5X5_100")
CHESS = Board(kind="chessboard", columns=9, rows=6, square_m=0.022)
GRID = Board(kind="apriltag", columns=4, rows=3, square_m=0.06, marker_m=0.048, dictionary="36h11")
SINGLE = Board(kind="aruco", square_m=0.1, dictionary="DICT_4X4_50")


def size_points(data: bytes) -> tuple[float, float]:
    found = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    assert found is not None
    return float(found[1]), float(found[2])


def rectangles(data: bytes) -> np.ndarray:
    """(N, 4) x, y, width, height of every rectangle [points], y up."""
    return np.array(re.findall(rb"^([\d.-]+) ([\d.-]+) ([\d.-]+) ([\d.-]+) re$", data, re.MULTILINE), float)


def drawn(data: bytes, dpi: int = DPI) -> np.ndarray:
    """The page in grey, its rectangles filled with 4 x 4 samples per pixel."""
    width, height = size_points(data)
    fine = 4 * dpi / 72
    page = np.full((round(height * fine), round(width * fine)), 255, np.uint8)
    for x, y, w, h in rectangles(data):
        low, high = round((height - y - h) * fine), round((height - y) * fine)
        page[low:high, round(x * fine) : round((x + w) * fine)] = 0
    size = (round(width * dpi / 72), round(height * dpi / 72))
    return np.asarray(cv2.resize(page, size, interpolation=cv2.INTER_AREA))


def by_poppler(data: bytes, folder: Path, dpi: int = DPI) -> np.ndarray:
    (folder / "board.pdf").write_bytes(data)
    subprocess.run(["pdftoppm", "-r", str(dpi), "-gray", "board.pdf", "page"], cwd=folder, check=True)
    (picture,) = folder.glob("page*.pgm")
    found = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
    assert found is not None
    return np.asarray(found)


@pytest.fixture(params=["parsed", "poppler"])
def raster(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    if request.param == "parsed":
        return drawn
    if shutil.which("pdftoppm") is None:
        pytest.skip("needs pdftoppm (poppler)")
    return lambda data: by_poppler(data, tmp_path)


def dictionary(name: str) -> Any:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def test_a_charuco_board_is_found_at_its_size(raster):
    picture = raster(board_sheet.pdf(CHARUCO))
    board = cv2.aruco.CharucoBoard((7, 5), 0.033, 0.024, dictionary("DICT_5X5_100"))
    corners, numbers, _, markers = cv2.aruco.CharucoDetector(board).detectBoard(picture)
    assert len(numbers) == 24
    assert len(markers) == 17
    millimetres = corners.reshape(-1, 2) / DPI * 25.4
    wanted = 1000 * board.getChessboardCorners()[numbers.ravel(), :2]
    offset = (millimetres - wanted).mean(axis=0)
    assert np.abs(millimetres - wanted - offset).max() < 0.05


def test_a_chessboard_is_found_at_its_size(raster):
    found, corners = cv2.findChessboardCornersSB(raster(board_sheet.pdf(CHESS, "letter")), (9, 6))
    assert found
    millimetres = corners.reshape(6, 9, 2) / DPI * 25.4
    np.testing.assert_allclose(np.linalg.norm(np.diff(millimetres, axis=1), axis=2), 22.0, atol=0.06)
    np.testing.assert_allclose(np.linalg.norm(np.diff(millimetres, axis=0), axis=2), 22.0, atol=0.06)


@pytest.mark.parametrize(
    ("board", "paper", "name"), [(GRID, "a3", "DICT_APRILTAG_36h11"), (SINGLE, "a4", "DICT_4X4_50")]
)
def test_markers_are_found_at_their_size_and_place(raster, board, paper, name):
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary(name)).detectMarkers(raster(board_sheet.pdf(board, paper)))
    order = np.argsort(numbers.ravel())
    assert list(numbers.ravel()[order]) == list(range(board.columns * board.rows))
    millimetres = np.array([corners[each][0] for each in order]) / DPI * 25.4
    side = 1000 * (board.marker_m or board.square_m)
    np.testing.assert_allclose(np.linalg.norm(millimetres[:, 1] - millimetres[:, 0], axis=1), side, atol=0.25)
    places = millimetres[:, 0].reshape(board.rows, board.columns, 2)
    np.testing.assert_allclose(np.diff(places[..., 0], axis=1), 1000 * board.square_m, atol=0.2)
    np.testing.assert_allclose(np.diff(places[..., 1], axis=0), 1000 * board.square_m, atol=0.2)


@pytest.mark.parametrize(
    ("paper", "board", "points"),
    [
        ("a4", CHARUCO, (841.889764, 595.275591)),
        ("letter", CHESS, (792.0, 612.0)),
        ("a3", GRID, (841.889764, 1190.551181)),
        ("a4", SINGLE, (595.275591, 841.889764)),
    ],
)
def test_the_page_has_the_size_of_its_paper(paper, board, points):
    np.testing.assert_allclose(size_points(board_sheet.pdf(board, paper)), points, atol=1e-5)


def test_the_bar_is_100_mm_and_nothing_is_in_the_margin():
    data = board_sheet.pdf(CHARUCO)
    found = rectangles(data)
    bar = found[-12:] / 72 * 25.4
    assert bar[:, 0].min() == pytest.approx(10.0, abs=1e-4)
    assert (bar[:, 0] + bar[:, 2]).max() - bar[:, 0].min() == pytest.approx(100.0, abs=1e-4)
    width, height = size_points(data)
    assert found[:, :2].min() > 28.0
    assert (found[:, 0] + found[:, 2]).max() < width - 28.0
    assert (found[:, 1] + found[:, 3]).max() < height - 28.0


def test_it_says_what_it_is_and_is_the_same_each_time():
    data = board_sheet.pdf(CHARUCO)
    assert data == board_sheet.pdf(CHARUCO)
    assert rb"\(" not in data
    for text in (b"square 33 mm, marker 24 mm, DICT_5X5_100", b'"square_m": 0.033', b"/PrintScaling /None"):
        assert text in data
    start = int(data.split(b"startxref\n")[1].split()[0])
    assert data[start : start + 4] == b"xref"
    for number, row in enumerate(data[start:].splitlines()[3:9], 1):
        assert data[int(row.split()[0]) :].startswith(b"%d 0 obj" % number)


@pytest.mark.parametrize(
    ("board", "paper", "says"),
    [
        (CHARUCO.model_copy(update={"square_m": 0.06}), "a4", "does not fit on a4"),
        (CHARUCO, "a5", "no paper is called `a5`"),
        (CHARUCO.model_copy(update={"dictionary": "5X5"}), "a4", "no dictionary of markers is called `5X5`"),
        (
            Board(kind="charuco", columns=16, rows=15, square_m=0.01, marker_m=0.007, dictionary="DICT_4X4_100"),
            "a4",
            "needs 120 markers",
        ),
    ],
)
def test_a_board_that_cannot_be_printed_is_refused(board, paper, says):
    with pytest.raises(ArtifactError, match=says):
        board_sheet.pdf(board, paper)
