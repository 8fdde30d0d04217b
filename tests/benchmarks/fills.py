"""Print how the surface goes on where objects are removed from photographs.

    python -m tests.benchmarks.fills [CAPTURE ...]

Without names, all photographs with depth that lie outside the project. *Taken out* is the part of the picture that
belongs to objects; *no depth* the part of it, and of the objects' surroundings that are filled as well, without a
surface; *beside one* the same of pixels whose nearest visible neighbour has a surface, which must go on; *step* the
median difference of colour across the border of the fill, over 8 px and in grey levels of 255, and *elsewhere* the same
difference on the same surfaces away from it, which a fill that nobody sees does not exceed.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.errors import DxbError
from dextera_build.testing import RuleRunner

SHARED = Path(__file__).parents[3] / "shared"
ACROSS_PX = 8


class Fill(NamedTuple):
    """How one photograph was filled."""

    taken: float
    bare: float
    ended: float
    step: float
    elsewhere: float


def photographs(names: list[str]) -> list[Path]:
    """Folders of the photographs with depth that lie outside the project; `names` of them, or all."""
    found = sorted([*(SHARED / "captures").iterdir(), *(SHARED / "faults").iterdir()])
    return [path for path in found if (path / "depth.png").is_file() and (not names or path.name in names)]


def main(names: list[str]) -> None:
    """One row per photograph."""
    print(
        "| photograph | taken out [%] | no depth [%] | beside one [%] | step | elsewhere |\n|---|---|---|---|---|---|"
    )
    for path in photographs(names):
        with tempfile.TemporaryDirectory() as folder:
            try:
                fill = filled(RuleRunner(Path(folder)), path)
            except DxbError as error:
                print(f"| {path.name} | {error} | | | | |", flush=True)
                continue
        shares = f"{100 * fill.taken:.1f} | {100 * fill.bare:.2f} | {100 * fill.ended:.2f}"
        print(f"| {path.name} | {shares} | {fill.step:.1f} | {fill.elsewhere:.1f} |", flush=True)


def filled(runner: RuleRunner, path: Path) -> Fill:
    """Take the objects out of a photograph, as the recipe of twins does, and measure what stands in their place."""
    files = {each.name: each.read_bytes() for each in path.iterdir() if each.is_file()}
    capture = runner.run("capture.folder", folder=Folder(files=files))
    seen = {"photograph": capture.photograph, "measured": capture.measured}
    support = runner.run("align.support", **seen)
    elements = runner.run("factorize.parse", **seen, support=support)
    objects = runner.run("factorize.segment", **seen, elements=elements, support=support)
    made = runner.run("background.static", **seen, support=support, instances=objects.map)
    return measured(made, capture.photograph.rgb.pixels, objects.map.labels > 0)


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
    )


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
