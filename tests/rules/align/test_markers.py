"""align.photographs by printed markers on a bare table, where nothing else tells two photographs' places."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.cameras.image import Image
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, transforms
from dextera_build.testing import RuleRunner
from tests import factories, tabletops
from tests.installed import needs
from tests.tabletops import Tabletop

needs("open3d", "pycolmap")

BOX = (tabletops.box(0.1, 0.06, 0.14, (0.75, 0.1, 0.1)), factories.pose(-0.1, 0.05, yaw=0.2))
INK_M, PAPER_M = 0.07, 0.1
"""Sides of a marker and of its paper."""


def taken(degrees: float, *sheets: tuple[int, float, float]) -> Tabletop:
    """A bare table with a box, and markers (number, x, y [m]) flat on it."""
    angle = np.radians(degrees)
    eye = factories.look_at((0.6 * np.sin(angle), -0.6 * np.cos(angle), 0.6))
    shot = tabletops.tabletop(BOX, eye=eye, lens=tabletops.FINE, seed=int(degrees))
    rgb = shot.capture.photograph.rgb.pixels.copy()
    for number, x, y in sheets:
        printed(rgb, shot, number, (x, y))
    photograph = shot.capture.photograph.model_copy(update={"rgb": Image(pixels=rgb)})
    return Tabletop(shot.capture.model_copy(update={"photograph": photograph}), shot.labels, eye)


def printed(rgb: np.ndarray, shot: Tabletop, number: int, place: tuple[float, float]) -> None:
    """Draw a marker (number) on its paper, flat on the table with its middle at `place` [m], into the picture."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    border = round(210 * (PAPER_M / INK_M - 1) / 2)
    paper = np.pad(cv2.aruco.generateImageMarker(dictionary, number, 210), border, constant_values=255)
    around = 0.5 * PAPER_M * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) + place
    k = shot.capture.photograph.camera.matrix()
    on_table = np.column_stack([around, np.zeros(4)])
    pixels = cameras.project(transforms.apply(transforms.invert(shot.world_from_camera), on_table), k)
    side = len(paper) - 1
    sheet = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32)
    homography = cv2.getPerspectiveTransform(sheet, pixels.astype(np.float32))
    size = rgb.shape[1::-1]
    ink = cv2.warpPerspective(paper, homography, size, flags=cv2.INTER_AREA)
    there = (cv2.warpPerspective(np.full_like(paper, 255), homography, size) > 127) & (shot.labels.labels == 0)
    rgb[there] = ink[there, None]


def placed(folder: Path, first: Tabletop, other: Tabletop) -> np.ndarray:
    """T_true_found (4, 4) of the second photograph's camera."""
    further = FurtherPhotographs(items=(Further(file="side.png", capture=other.capture, pose=None),))
    (one,) = RuleRunner(folder).run("align.photographs", photo=first.capture, further=further).items
    return transforms.invert(other.world_from_camera) @ first.world_from_camera @ one.pose.matrix


@pytest.mark.slow
def test_a_bare_table_tells_no_place(tmp_path):
    with pytest.raises(RuleError, match=r"`side\.png` (cannot be placed|contradicts)|lengths in `side\.png`"):
        placed(tmp_path, taken(0), taken(60))


@pytest.mark.slow
@pytest.mark.parametrize(("count", "degrees"), [(1, 60), (3, 60), (3, 150)])
def test_printed_markers_place_a_photograph_from_far_beside_the_first(tmp_path, count, degrees):
    sheets = ((7, 0.1, -0.05), (3, -0.1, -0.12), (12, 0.02, 0.12))[:count]
    off = placed(tmp_path, taken(0, *sheets), taken(degrees, *sheets))
    assert 1000 * np.linalg.norm(off[:3, 3]) < 6.0
    assert np.degrees(transforms.angle(off[:3, :3])) < 0.6


@pytest.mark.medium
def test_a_marker_that_was_moved_between_the_photographs_is_refused(tmp_path):
    with pytest.raises(RuleError, match=r"`side\.png` contradicts the other photographs") as caught:
        placed(tmp_path, taken(0, (7, 0.1, -0.05)), taken(60, (7, 0.25, -0.15)))
    assert "on no table or wall, 35% needed" in caught.value.facts["things"]
