"""Picture of a shape: the crop, the shape over the crop, and the shape from two other sides."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import MeasuredView, ObjectView
from dextera_build.geometry import raycast, transforms

SIDE_PX = 260
"""Width and height of each part [px]."""
PAPER = 236
"""Grey level of the background of the other views."""
FRONT = np.array([0.0, -1.0, 0.5])
"""Direction of the first other view if nothing was measured, object frame."""


def picture(
    shape: Shape, view: ObjectView, measured: MeasuredView | None, turns: tuple[float, ...] = (100.0, 200.0)
) -> np.ndarray | None:
    """(SIDE_PX, n SIDE_PX, 3) uint8, or None if no ray caster is installed; the overlay needs a measured pose.

    Args:
        shape: The shape.
        view: The view that it explains.
        measured: Its measurements.
        turns: Rotations about the vertical from the capturing camera to the other views [deg].
    """
    try:
        body = surface(shape)
        parts, eye = [_fitted(view.rgb.pixels)], None
        if measured is not None and shape.pose is not None:
            parts.append(_fitted(_overlay(body, view, measured.camera_pose.matrix)))
            eye = measured.camera_pose.matrix[:3, 3]
        parts += [_from_side(body, eye, np.deg2rad(turn)) for turn in turns]
    except ModuleNotFoundError:
        return None
    return np.concatenate(parts, axis=1)


def surface(shape: Shape) -> raycast.Surface:
    """The textured mesh in the world frame, or in its own if it has no pose."""
    texture = None if shape.mesh.texture is None else shape.mesh.texture.pixels
    vertices = shape.mesh.vertices.astype(np.float64)
    if shape.pose is not None:
        vertices = transforms.apply(shape.pose.matrix, vertices)
    return raycast.Surface(vertices, shape.mesh.faces, shape.mesh.uv, texture, shape.mesh.colour)


def _overlay(body: raycast.Surface, view: ObjectView, world_from_camera: np.ndarray) -> np.ndarray:
    height, width = view.mask.shape
    shown = raycast.render([body], view.camera.matrix(), world_from_camera, height, width)
    covered = shown.index >= 0
    pixels = (view.rgb.pixels * 0.45).astype(np.uint8)
    pixels[covered] = raycast.shade([body], shown)[covered]
    edge = covered.copy()
    edge[1:-1, 1:-1] &= ~(covered[:-2, 1:-1] & covered[2:, 1:-1] & covered[1:-1, :-2] & covered[1:-1, 2:])
    pixels[edge] = (40, 230, 60)
    return pixels


def _from_side(body: raycast.Surface, eye: np.ndarray | None, turn: float) -> np.ndarray:
    middle = (body.vertices.min(axis=0) + body.vertices.max(axis=0)) / 2
    size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
    start = FRONT if eye is None else eye - middle
    bearing = np.arctan2(start[1], start[0]) + turn
    rise = np.deg2rad(30.0)
    away = np.array([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise), np.sin(rise)])
    down = np.array([0.0, 0.0, -1.0]) + away * away[2]
    down /= np.linalg.norm(down)
    pose = transforms.rigid(np.stack([np.cross(down, -away), down, -away], axis=-1), middle + 3.0 * size * away)
    focal = 2.6 * SIDE_PX
    k = np.array([[focal, 0, SIDE_PX / 2], [0, focal, SIDE_PX / 2], [0, 0, 1.0]])
    shown = raycast.render([body], k, pose, SIDE_PX, SIDE_PX)
    lamp = away + np.array([0.0, 0.0, 0.6])
    light = 0.55 + 0.45 * np.clip(shown.normal @ lamp / np.linalg.norm(lamp), 0, 1)
    pixels = np.asarray(raycast.shade([body], shown) * light[..., None], np.uint8)
    pixels[shown.index < 0] = PAPER
    return pixels


def _fitted(pixels: np.ndarray) -> np.ndarray:
    """The picture scaled to fit a square."""
    from PIL import Image as Pillow

    height, width = pixels.shape[:2]
    scale = SIDE_PX / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = np.asarray(Pillow.fromarray(np.ascontiguousarray(pixels)).resize(size, Pillow.Resampling.LANCZOS))
    page = np.full((SIDE_PX, SIDE_PX, 3), PAPER, np.uint8)
    top, left = (SIDE_PX - size[1]) // 2, (SIDE_PX - size[0]) // 2
    page[top : top + size[1], left : left + size[0]] = small
    return page
