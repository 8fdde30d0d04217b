"""Upright edges of boxes tell the direction up, and edges that run away on the table do not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.geometry import cameras, transforms
from dextera_build.testing import RuleRunner
from rules.align.support import uprights

CAMERA = Camera(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
BOXES = [(-0.3, 0.1, 0.2, 0.3), (-0.08, -0.1, 0.25, -0.2), (0.15, 0.05, 0.16, 0.5), (0.36, 0.12, 0.22, 0.1)]
"""Centre, height [m] and yaw [rad] of boxes with edges of 80 mm."""


def photograph(pitch_deg: float, roll_deg: float = 0.0, boxes: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of boxes on a table with a border, and the direction up in the frame of the camera."""
    look = cameras.look_down(np.array([0.0, 0.0, 0.05]), 1.0, 0.0, np.radians(pitch_deg), np.radians(roll_deg))
    view = transforms.invert(look)
    pixels = np.full((480, 640, 3), 205, np.uint8)
    table = np.array([[-0.55, -0.4, 0], [0.55, -0.4, 0], [0.55, 0.5, 0], [-0.55, 0.5, 0]])
    _fill(pixels, view, table, 120)
    order = sorted(BOXES, key=lambda each: -each[1]) if boxes else []
    for x, y, height, yaw in order:
        for number, face in enumerate(_faces(x, y, height, yaw)):
            towards = transforms.apply(view, face)
            normal = np.cross(towards[1] - towards[0], towards[2] - towards[0])
            if normal @ towards[0] < 0:
                _fill(pixels, view, face, 40 + 30 * number)
    noise = np.random.default_rng(0).normal(0, 2.0, pixels.shape)
    return np.clip(pixels + noise, 0, 255).astype(np.uint8), np.asarray(view[:3, 2])


def _faces(x: float, y: float, height: float, yaw: float) -> list[np.ndarray]:
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    flat = np.array([[-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [-0.04, 0.04]]) @ turn.T + [x, y]
    low, high = (np.column_stack([flat, np.full(4, z)]) for z in (0.0, height))
    sides = [np.stack([low[n], low[(n + 1) % 4], high[(n + 1) % 4], high[n]]) for n in range(4)]
    return [*sides, high]


def _fill(pixels: np.ndarray, view: np.ndarray, corners: np.ndarray, grey: int) -> None:
    seen = transforms.apply(view, corners) @ CAMERA.matrix().T
    places = np.round(16 * seen[:, :2] / seen[:, 2:]).astype(np.int32)
    cv2.fillPoly(pixels, [places], (grey, grey, grey), cv2.LINE_AA, 4)


def error_deg(found: uprights.Uprights | None, up: np.ndarray) -> float:
    assert found is not None
    return float(np.degrees(np.arccos(np.clip(found.direction @ up, -1.0, 1.0))))


@pytest.mark.parametrize(("pitch", "roll"), [(20.0, 0.0), (35.0, 8.0), (50.0, -8.0)])
def test_upright_edges_tell_the_direction_up(pitch, roll):
    pixels, up = photograph(pitch, roll)
    assert error_deg(uprights.find(pixels, CAMERA.matrix()), up) < 1.5


@pytest.mark.parametrize("pitch", [25.0, 50.0, 85.0])
def test_a_bare_table_tells_nothing(pitch):
    pixels, _ = photograph(pitch, boxes=False)
    assert uprights.find(pixels, CAMERA.matrix()) is None


def test_a_photograph_without_depth_gets_its_pitch_from_them(tmp_path):
    pixels, up = photograph(50.0)
    runner = RuleRunner(tmp_path)
    seen = Photograph(rgb=Image(pixels=pixels), camera=CAMERA)
    found = runner.run("align.support", photograph=seen)
    assert error_deg(uprights.Uprights(found.camera_pose.matrix[2, :3], 0), up) < 1.5
    assert runner.outcome.line.startswith("by upright lines: the camera looks down by ")
    assert np.degrees(np.sqrt(np.diag(found.camera_pose.covariance)[3:5])) == pytest.approx(3.0, rel=0.05)
    stated = runner.run("align.support", photograph=seen, options={"pitch_deg": 35.0})
    assert runner.outcome.line.startswith("stated: the camera looks down by 35 deg")
    assert stated.camera_pose.matrix[2, 2] != found.camera_pose.matrix[2, 2]
