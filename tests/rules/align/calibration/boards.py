"""Calibration captures drawn by a homography: boards of all kinds, seen by a camera that is known."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.cameras.camera import Camera, Capture, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import boards, poses, transforms
from dextera_build.geometry.hand_eye import Solution, View
from tests.geometry import hand_eyes
from tests.geometry.hand_eyes import Errors

CAMERA = Camera(width=640, height=480, fx=607.6, fy=607.6, cx=323.5, cy=243.3)
DOT = 0.0005
"""Side of a pixel of a drawn board [m]."""

MARKER = Board(kind="apriltag", square_m=0.06, dictionary="36h11")
GRID = Board(kind="aruco", columns=4, rows=3, square_m=0.04, marker_m=0.03, dictionary="DICT_4X4_50")
CHARUCO = Board(kind="charuco", columns=6, rows=5, square_m=0.03, marker_m=0.022, dictionary="DICT_5X5_100")
CHESS = Board(kind="chessboard", columns=7, rows=5, square_m=0.025)
CIRCLES = Board(kind="circles", columns=7, rows=5, square_m=0.025)
ASYMMETRIC = Board(kind="asymmetric_circles", columns=4, rows=11, square_m=0.014)


def corners(board: Board) -> np.ndarray:
    """Corners (J, 3) by which a board's place in the picture is chosen [m]."""
    if board.kind == "chessboard":
        return boards.corners(board.columns, board.rows, board.square_m)
    if board.kind.endswith("circles"):
        return boards.circles(board.columns, board.rows, board.square_m, asymmetric=board.kind == "asymmetric_circles")
    if board.columns * board.rows == 1:
        return boards.marker(board.square_m)
    if board.kind == "charuco":
        return boards.corners(board.columns + 1, board.rows + 1, board.square_m)
    return boards.markers(board.columns, board.rows, board.square_m, board.marker_m).reshape(-1, 3)


def sheet(board: Board, *, reverse: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A board as printed, (H, W) uint8, and the (3, 3) map from board coordinates [m] to its pixels."""

    def dots(length: float) -> int:
        return round(length / DOT)

    kinds = {"aruco": "DICT_4X4_50", "apriltag": "DICT_APRILTAG_36h11", "charuco": "DICT_5X5_100"}
    margin = dots(0.02)
    if board.kind == "chessboard":
        side = dots(board.square_m)
        row, column = np.indices(((board.rows + 1) * side, (board.columns + 1) * side)) // side
        ink = np.where((row + column) % 2 == 0, 0, 255).astype(np.uint8)
        origin = side
    elif board.kind.endswith("circles"):
        centres = corners(board)[:, :2] / DOT
        origin = dots(board.square_m)
        ink = np.full(np.ceil(centres.max(axis=0) + 2 * origin).astype(int)[::-1], 255, np.uint8)
        for x, y in centres:
            cv2.circle(ink, (round(x + origin), round(y + origin)), round(0.35 * origin), 0, -1, cv2.LINE_AA)
    else:
        family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, kinds[board.kind]))
        origin = 0
        if board.kind == "charuco":
            pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, family)
            ink = pattern.generateImage((dots(board.columns * board.square_m), dots(board.rows * board.square_m)))
        elif board.columns * board.rows == 1:
            ink = cv2.aruco.generateImageMarker(family, 7, dots(board.square_m))
        else:
            pitch, side = dots(board.square_m), dots(board.marker_m)
            ink = np.full((board.rows * pitch, board.columns * pitch), 255, np.uint8)
            for number in range(board.columns * board.rows):
                row, column = divmod(number, board.columns)
                drawn = row * board.columns + board.columns - 1 - column if reverse else number
                place = np.s_[row * pitch : row * pitch + side, column * pitch : column * pitch + side]
                ink[place] = cv2.aruco.generateImageMarker(family, drawn, side)
    paper = np.pad(ink, margin, constant_values=255)
    offset = margin + origin - 0.5
    scale = np.diag([1 / DOT, 1 / DOT, 1.0])
    if board.columns * board.rows == 1:
        scale[1, 1] *= -1
        offset += dots(board.square_m) / 2
    scale[:2, 2] = offset
    return paper, scale


def drawn(board: Board, camera_board: np.ndarray, seed: int = 0, *, reverse: bool = False) -> np.ndarray:
    """A picture (H, W, 3) uint8 of a board at T_camera_board, slightly blurred and noisy."""
    paper, to_paper = sheet(board, reverse=reverse)
    k = CAMERA.matrix()
    homography = k @ camera_board[:3, [0, 1, 3]] @ np.linalg.inv(to_paper)
    fine = np.diag([3.0, 3.0, 1.0]) @ np.array([[1, 0, 1 / 3], [0, 1, 1 / 3], [0, 0, 1.0]]) @ homography
    large = cv2.warpPerspective(
        paper, fine, (3 * CAMERA.width, 3 * CAMERA.height), flags=cv2.INTER_AREA, borderValue=130
    )
    picture = cv2.resize(large, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA).astype(np.float64)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.6) * 0.75 + 25
    picture += np.random.default_rng(seed).normal(size=picture.shape) * 2.0
    return np.repeat(np.clip(picture, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def capture(pixels: np.ndarray) -> Capture:
    """A picture without depth."""
    return Capture(photograph=Photograph(rgb=Image(pixels=pixels), camera=CAMERA))


@cache
def taken(
    board: Board, seed: int = 1, count: int = 8, *, in_hand: bool = False, errors: Errors | None = None, **how: object
) -> tuple[RobotViews, Solution]:
    """A calibration capture with its truth, drawn once; it is not to be changed."""
    reverse = bool(how.pop("reverse", False))
    errors = errors or Errors(0.0, 0.0003, 0.0005)
    views, _, truth = hand_eyes.simulate(
        seed,
        count,
        in_hand=in_hand,
        board=corners(board),
        errors=errors,
        k=CAMERA.matrix(),
        away=board.columns * board.rows > 1,
        **how,
    )  # type: ignore[arg-type]
    pictures = {
        view.name: capture(drawn(board, view.candidates[0], i, reverse=reverse)) for i, view in enumerate(views)
    }
    return viewed(pictures, views, board, in_hand=in_hand), truth


def viewed(pictures: dict[str, Capture], views: list[View], board: Board, *, in_hand: bool = False) -> RobotViews:
    """Pictures with the robot's poses of `views`."""
    return RobotViews(
        captures=pictures,
        mount="eye_in_hand" if in_hand else "eye_on_base",
        effectors=np.stack([poses.from_matrix(view.effector) for view in views]),
        board=board,
    )


def off(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Distance [mm] and angle [deg] between two poses."""
    gap = transforms.invert(truth) @ found
    return 1000 * float(np.linalg.norm(gap[:3, 3])), float(np.degrees(transforms.angle(gap[:3, :3])))
