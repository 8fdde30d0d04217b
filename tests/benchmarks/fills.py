"""Print how the surface goes on where objects are removed from photographs.

    python -m tests.benchmarks.fills [CAPTURE ...]

Without names, all photographs with depth that lie outside the project. *Taken out* is the part of the picture that
belongs to objects; *no depth* the part of it, and of the objects' surroundings that are filled as well, without a
surface; *beside one* the same of pixels whose nearest visible neighbour has a surface, which must go on; *step* the
median difference of colour across the border of the fill, over 8 px and in grey levels of 255, and *elsewhere* the same
difference on the same surfaces away from it, which a fill that nobody sees does not exceed. *Seam* is the step of
colour (CIE76) from the photographed support to its invented continuation beyond the border of the picture, minus the
step between neighbouring lines on both sides of it: the colours of lines 10 mm wide and 100 mm long along the border,
their mean over all such pieces.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import DxbError
from dextera_build.geometry import cameras, metrics, raycast, transforms
from dextera_build.testing import RuleRunner

SHARED = Path(__file__).parents[3] / "shared"
ACROSS_PX = 8
LINE_M, PIECE_M, RAY_M = 0.01, 0.1, 0.002
"""Width and length of the lines along the picture's border whose colours are compared, and spacing of their rays."""
LEVEL_M = 0.003
"""Largest distance of the support's surfaces from its plane [m]."""


class Fill(NamedTuple):
    """How one photograph was filled."""

    taken: float
    bare: float
    ended: float
    step: float
    elsewhere: float
    seam: float


def photographs(names: list[str]) -> list[Path]:
    """Folders of the photographs with depth that lie outside the project; `names` of them, or all."""
    found = sorted([*(SHARED / "captures").iterdir(), *(SHARED / "faults").iterdir()])
    return [path for path in found if (path / "depth.png").is_file() and (not names or path.name in names)]


def main(names: list[str]) -> None:
    """One row per photograph."""
    print(
        "| photograph | taken out [%] | no depth [%] | beside one [%] | step | elsewhere | seam |\n"
        "|---|---|---|---|---|---|---|"
    )
    for path in photographs(names):
        with tempfile.TemporaryDirectory() as folder:
            try:
                fill = filled(RuleRunner(Path(folder)), path)
            except DxbError as error:
                print(f"| {path.name} | {error} | | | | | |", flush=True)
                continue
        shares = f"{100 * fill.taken:.1f} | {100 * fill.bare:.2f} | {100 * fill.ended:.2f}"
        print(f"| {path.name} | {shares} | {fill.step:.1f} | {fill.elsewhere:.1f} | {fill.seam:.1f} |", flush=True)


def filled(runner: RuleRunner, path: Path) -> Fill:
    """Take the objects out of a photograph, as the recipe of twins does, and measure what stands in their place."""
    files = {each.name: each.read_bytes() for each in path.iterdir() if each.is_file()}
    capture = runner.run("capture.folder", folder=Folder(files=files))
    seen = {"photograph": capture.photograph, "measured": capture.measured}
    support = runner.run("align.support", **seen)
    elements = runner.run("factorize.parse", **seen, support=support)
    objects = runner.run("factorize.segment", **seen, elements=elements, support=support)
    made = runner.run("background.static", **seen, support=support, instances=objects.map)
    return measured(made, capture.photograph.rgb.pixels, objects.map.labels > 0)._replace(
        seam=seam(made, capture.photograph.camera, support.camera_pose.matrix)
    )


def measured(made: Background, pixels: np.ndarray, objects: np.ndarray) -> Fill:
    """Compare the empty scene with the photograph.

    Args:
        made: The scene without objects.
        pixels: (H, W, 3) uint8 photograph.
        objects: (H, W) bool, pixels of objects.
    """
    changed = np.abs(made.image.pixels.astype(int) - pixels).max(axis=-1) > 0
    near = cv2.dilate(objects.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    hole = objects | (changed & near)
    steps = _steps(made.image.pixels)
    border = cv2.morphologyEx(objects.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)) > 0
    level = made.depth.depth > 0
    away = level & ~(cv2.dilate(hole.astype(np.uint8), np.ones((41, 41), np.uint8)) > 0)
    beside = away & (cv2.dilate(hole.astype(np.uint8), np.ones((161, 161), np.uint8)) > 0)
    return Fill(
        float(objects.mean()),
        float((~level)[hole].mean()) if hole.any() else 0.0,
        float((~level & _nearest(level, ~hole))[hole].mean()) if hole.any() else 0.0,
        float(np.median(steps[border & level])) if (border & level).any() else 0.0,
        float(np.median(steps[beside])) if beside.any() else 0.0,
        float("nan"),
    )


def seam(made: Background, camera: Camera, world_from_camera: np.ndarray) -> float:
    """Step of colour (CIE76) across the picture's border on the support, minus that between lines beside it.

    Not a number if the support does not go on beyond the border.

    Args:
        made: The scene without objects.
        camera: The picture's camera.
        world_from_camera: (4, 4) T_world_camera [m].
    """
    shown, invented = (raycast.Sorted([_level(mesh)]) for mesh in (made.mesh, made.invented) if mesh is not None)
    steps = []
    for start, along, outward, length in _sides(camera, world_from_camera):
        for begin in np.arange(0.0, length - PIECE_M, PIECE_M):
            corner = start + begin * along
            inner = [_line(shown, corner - n * LINE_M * outward, along, outward) for n in (2, 1)]
            outer = [_line(invented, corner + n * LINE_M * outward, along, outward) for n in (0, 1)]
            if all(line is not None for line in inner + outer):
                steps.append(np.linalg.norm(np.diff(np.array(inner + outer), axis=0), axis=1))
    if not steps:
        return float("nan")
    before, across, after = np.mean(steps, axis=0)
    return float(across - (before + after) / 2)


def _level(mesh: Mesh) -> raycast.Surface:
    """The faces of a mesh that are in the support's plane."""
    assert mesh.uv is not None
    assert mesh.texture is not None
    flat = (np.abs(mesh.vertices[:, 2]) < LEVEL_M)[mesh.faces].all(axis=1)
    return raycast.Surface(mesh.vertices, mesh.faces[flat], mesh.uv[flat], mesh.texture.pixels)


def _sides(camera: Camera, pose: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    """The picture's border on the support: start (2,), direction (2,), outward direction (2,) and length of each side.

    What is farther than 3 m is left out.
    """
    width, height = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [-0.5, height], [width, height], [width, -0.5]])
    middle = np.array([camera.width, camera.height]) / 2
    found = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        pixel = a + (b - a) * np.linspace(0.0, 1.0, 500)[:, None]
        rays = cameras.directions(pixel, camera.matrix()) @ pose[:3, :3].T
        down = -pose[2, 3] / np.minimum(rays[:, 2], -1e-9)
        near = (rays[:, 2] < 0) & (down < 3.0)
        if near.sum() < 2:
            continue
        points = (pose[:3, 3] + rays * down[:, None])[near, :2]
        along = points[-1] - points[0]
        length = float(np.linalg.norm(along))
        along /= length
        inside = np.linalg.inv(camera.matrix() @ transforms.invert(pose)[:3, [0, 1, 3]]) @ [*middle, 1.0]
        outward = np.array([along[1], -along[0]])
        outward *= -np.sign(outward @ (inside[:2] / inside[2] - points[0]))
        found.append((points[0], along, outward, length))
    return found


def _line(surfaces: raycast.Sorted, corner: np.ndarray, along: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Mean colour (3,) in CIE L*a*b* of a line of the support that starts at a corner (2,); None where it ends."""
    u, v = (np.arange(RAY_M / 2, size, RAY_M) for size in (PIECE_M, LINE_M))
    points = corner + u[:, None, None] * along + v[None, :, None] * across
    rays = np.zeros((*points.shape[:2], 6), np.float32)
    rays[..., :2], rays[..., 2], rays[..., 5] = points, 1.0, -1.0
    seen = raycast.cast(surfaces, rays)
    if (seen.index < 0).mean() > 0.05:
        return None
    return np.asarray(metrics.lab(raycast.shade(surfaces, seen)[seen.index >= 0]).mean(axis=0), np.float64)


def _nearest(values: np.ndarray, where: np.ndarray) -> np.ndarray:
    """The value (H, W) of the nearest pixel of `where`."""
    _, labels = cv2.distanceTransformWithLabels(
        (~where).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    known = np.zeros(labels.max() + 1, bool)
    known[labels[where]] = values[where]
    return np.asarray(known[labels])


def _steps(pixels: np.ndarray) -> np.ndarray:
    """Largest difference (H, W) of the smoothed colour between both sides of each pixel."""
    soft = cv2.blur(pixels.astype(np.float32), (5, 5))
    half = ACROSS_PX // 2
    found = np.zeros(pixels.shape[:2])
    for axis in (0, 1):
        apart = np.abs(np.roll(soft, half, axis) - np.roll(soft, -half, axis)).mean(axis=-1)
        found = np.maximum(found, apart)
    return found


if __name__ == "__main__":
    main(sys.argv[1:])
