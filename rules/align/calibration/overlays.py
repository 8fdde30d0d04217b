"""Pictures of a calibration: the board's predicted axes and corners over each picture."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import hand_eye, transforms
from dextera_build.geometry.hand_eye import Setup
from dextera_build.geometry.hand_eye_checks import Checked
from dextera_build.previews import rigs
from dextera_build.rule import Context

AXES = ((220, 60, 60), (60, 180, 75), (60, 100, 230))
MOST = 12
"""Maximum number of pictures shown."""
SIDE_PX = 480


def preview(ctx: Context, views: RobotViews, found: Checked, setup: Setup, calibration: Calibration) -> None:
    """Show the residuals, and the board as predicted by the robot's pose in every picture."""
    ctx.preview(rigs.residuals(calibration), "residuals (blue) and change without (orange)")
    tiles = []
    for view in found.views[:MOST]:
        pixels = views.captures[view.name].photograph.rgb.pixels
        camera_board = hand_eye.predicted(found.refined.solution, view, setup)
        offsets = hand_eye.offsets(found.refined.solution, view, setup)
        rms = float(np.sqrt((offsets**2).sum(axis=1).mean()))
        tiles.append(drawn(pixels, camera_board, view.board, view.pixels, setup.k, f"{view.name}: {rms:.2f} px"))
    ctx.preview(mosaic(tiles), "board as the robot's pose implies it (axes, green), and as seen (red)")


def drawn(
    pixels: np.ndarray, camera_board: np.ndarray, board: np.ndarray, seen: np.ndarray, k: np.ndarray, text: str
) -> np.ndarray:
    """A picture (H, W, 3) uint8 with predicted corners and axes of a board, and the seen corners (J, 2)."""
    picture = Image.fromarray(pixels)
    pen = ImageDraw.Draw(picture)
    length = float(np.ptp(board, axis=0).max())
    ends = np.vstack([np.zeros(3), length * np.eye(3)])
    ends = transforms.apply(camera_board, ends)
    corners = transforms.apply(camera_board, board)
    if (ends[:, 2] > 1e-3).all():
        places = _projected(ends, k)
        for end, colour in zip(places[1:], AXES, strict=True):
            pen.line([tuple(places[0]), tuple(end)], fill=colour, width=3)
    for (x, y), (u, v) in zip(_projected(corners, k), seen, strict=True):
        pen.ellipse([u - 4, v - 4, u + 4, v + 4], outline=(230, 40, 40))
        pen.line([x - 4, y, x + 4, y], fill=(40, 230, 80))
        pen.line([x, y - 4, x, y + 4], fill=(40, 230, 80))
    label(pen, text)
    return np.asarray(picture)


def label(pen: ImageDraw.ImageDraw, text: str) -> None:
    """Draw a line of text into the upper left corner."""
    pen.rectangle([0, 0, 8 + pen.textlength(text), 14], fill=(0, 0, 0))
    pen.text((4, 1), text, fill=(255, 255, 255))


def mosaic(tiles: list[np.ndarray], columns: int = 3) -> np.ndarray:
    """Pictures side by side, each at most `SIDE_PX` wide, (H, W, 3) uint8."""
    small = []
    for tile in tiles:
        share = min(1.0, SIDE_PX / tile.shape[1])
        size = (round(tile.shape[1] * share), round(tile.shape[0] * share))
        small.append(np.asarray(Image.fromarray(tile).resize(size, Image.Resampling.BILINEAR)))
    height, width = max(each.shape[0] for each in small), max(each.shape[1] for each in small)
    across = min(columns, len(small))
    down = -(-len(small) // across)
    sheet = np.full((down * height, across * width, 3), 255, np.uint8)
    for number, each in enumerate(small):
        row, column = divmod(number, across)
        sheet[row * height : row * height + each.shape[0], column * width : column * width + each.shape[1]] = each
    return sheet


def _projected(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    return np.asarray(points[:, :2] / np.maximum(points[:, 2:], 1e-6) @ k[:2, :2].T + k[:2, 2])
