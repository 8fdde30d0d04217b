"""Views of known bodies with the faults of a depth camera: noise, quantisation, lost depth at edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.view import Instance, MeasuredView, ObjectView, Traits
from dextera_build.geometry import raycast, solids, transforms
from dextera_build.geometry.solids import Solid
from tests import factories


@dataclass(frozen=True)
class Eye:
    """A camera that looks at the origin of the support from `distance` at `pitch` above the horizon."""

    distance: float = 0.75
    pitch_deg: float = 35.0
    focal: float = 305.0
    size: tuple[int, int] = (320, 240)

    def pose(self) -> np.ndarray:
        """T_world_camera (4, 4), OpenCV axes."""
        pitch = np.deg2rad(self.pitch_deg)
        forward = np.array([0.0, np.cos(pitch), -np.sin(pitch)])
        right = np.array([1.0, 0.0, 0.0])
        down = np.cross(forward, right)
        return transforms.rigid(np.stack([right, down, forward], axis=-1), -self.distance * forward)

    def matrix(self) -> np.ndarray:
        """K (3, 3) [px]."""
        width, height = self.size
        middle = width * (0.5 - 3 / 640), height * (0.5 + 2 / 480)
        return np.array([[self.focal, 0, middle[0]], [0, self.focal, middle[1]], [0, 0, 1.0]])


def fine(**more: float) -> Eye:
    """A camera of twice as many pixels in a row; four times as dear."""
    return Eye(focal=610.0, size=(640, 480), **more)  # type: ignore[arg-type]


def view(body: Solid, eye: Eye, seed: int = 0, noise_m: float = 0.0015, hidden: tuple[Solid, ...] = ()) -> Instance:
    """What a depth camera sees of a body (world frame) on a table.

    Args:
        body: The object.
        eye: The camera.
        seed: Of the noise.
        noise_m: Standard deviation of the depth [m]; counts are whole millimetres.
        hidden: Other bodies that may stand in front.
    """
    random = np.random.default_rng(seed)
    table = solids.box((3.0, 3.0, 0.1), (0.0, 0.0, -0.05))
    surfaces = [raycast.Surface(part.vertices, part.faces) for part in (body, table, *hidden)]
    width, height = eye.size
    shown = raycast.render(surfaces, eye.matrix(), eye.pose(), height, width)
    mask = shown.index == 0
    depth = shown.depth + np.where(shown.depth > 0, random.normal(0.0, noise_m, shown.depth.shape), 0.0)
    depth = np.round(depth * 1000.0) / 1000.0
    depth[_edges(shown.index, shown.depth) & (random.random(depth.shape) < 0.7)] = 0.0
    colours = np.array([[150, 60, 50], [190, 180, 160], [60, 90, 60]])[np.minimum(shown.index, 2)]
    light = 0.6 + 0.4 * np.abs(shown.normal @ np.array([0.3, -0.6, 0.74]))
    rgb = np.clip(colours * light[..., None] + random.normal(0, 3, colours.shape), 0, 255).astype(np.uint8)
    rows, columns = np.nonzero(mask)
    top, bottom = max(int(rows.min()) - 24, 0), min(int(rows.max()) + 25, height)
    left, right = max(int(columns.min()) - 24, 0), min(int(columns.max()) + 25, width)
    box = np.s_[top:bottom, left:right]
    k = eye.matrix()
    camera = Camera(
        width=right - left, height=bottom - top, fx=k[0, 0], fy=k[1, 1], cx=k[0, 2] - left, cy=k[1, 2] - top
    )
    return Instance(
        view=ObjectView(
            rgb=Image(pixels=rgb[box].copy()),
            mask=mask[box].copy(),
            occluder=(shown.index >= 2)[box].copy(),
            camera=camera,
            phrase="thing",
        ),
        traits=Traits(category="object", body_type="rigid", material="plastic"),
        measured=MeasuredView(
            depth=DepthImage(depth=depth[box].astype(np.float32)), camera_pose=factories.placed(eye.pose(), "camera")
        ),
    )


def _edges(index: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels within two of a jump of the depth or of the body."""
    jump = np.zeros(index.shape, bool)
    for axis in (0, 1):
        step = (np.abs(np.diff(depth, axis=axis)) > 0.02) | (np.diff(index, axis=axis) != 0)
        here = [slice(None), slice(None)]
        for offset in (slice(None, -1), slice(1, None)):
            here[axis] = offset
            jump[tuple(here)] |= step
    return jump


def placed(body: Solid, x: float, y: float, yaw_deg: float) -> Solid:
    """The body stood at (x, y) on the support and turned."""
    yaw = np.deg2rad(yaw_deg)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
    return body.moved(transforms.rigid(turn, np.array([x, y, 0.0])))


def cup(bottom: float, top: float, height: float, wall: float, floor: float) -> Solid:
    """A conical cup with outer radii `bottom` and `top` [m]."""
    inside = bottom + (top - bottom) * floor / height
    radii = [(bottom, 0.0), (top, height), (top - wall, height), (inside - wall, floor)]
    return solids.loft(np.stack([solids.ring(r, r, 2.0, z, 72) for r, z in radii]))


def bowl(radius: float, foot: float, height: float, wall: float) -> Solid:
    """A round bowl: a foot of radius `foot`, a wall that curves up to `radius` at the rim [m]."""
    turn = np.linspace(0.0, 1.0, 12)
    outer = [(foot + (radius - foot) * np.sin(t * np.pi / 2), height * (1 - np.cos(t * np.pi / 2))) for t in turn]
    inner = [(r - wall, z) for r, z in outer[::-1] if z > 2 * wall]
    return solids.loft(np.stack([solids.ring(r, r, 2.0, z, 72) for r, z in outer + inner]))


def laptop(width: float, depth: float, thick: float, length: float, lid: float, angle_deg: float) -> Solid:
    """Two slabs: the base on the support, the lid hinged at its +y upper edge and opened by `angle_deg`."""
    angle = np.deg2rad(angle_deg)
    base = solids.box((width, depth, thick), (0, 0, thick / 2))
    up, out = np.array([0, -np.cos(angle), np.sin(angle)]), np.array([0, np.sin(angle), np.cos(angle)])
    corners = solids.box((1.0, 1.0, 1.0), (0.0, 0.5, 0.5))
    hinge = np.array([0.0, depth / 2, thick])
    vertices = hinge + corners.vertices @ np.array([[width, 0, 0], lid * out, length * up])
    return solids.join([base, Solid(vertices, corners.faces)])
