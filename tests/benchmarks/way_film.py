"""Film the way from a photograph to a policy, as the README shows it.

    python -m tests.benchmarks.way_film PROJECT OUT.webp

PROJECT is a folder that `dxb init` made. What `task/close_laptop` has not built there is built, in about 15 minutes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dextera_build.api import Project
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.sim.render.stills import Stills
from tests.benchmarks.twin_pictures import around

WIDTH_PX = 480
RATE_HZ = 10.0
COLOURS = np.array([[230, 80, 60], [60, 140, 230], [90, 180, 90], [220, 170, 50], [160, 90, 200]])

Captioned = tuple[str, np.ndarray]


def main() -> None:
    """Build, film and write."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("project", type=Path)
    asked.add_argument("out", type=Path)
    options = asked.parse_args()
    frames = [_captioned(caption, picture) for caption, picture in film(Project.find(options.project))]
    first, *others = [Image.fromarray(frame) for frame in frames]
    first.save(
        options.out, save_all=True, append_images=others, duration=round(1000 / RATE_HZ), loop=0, quality=60, method=4
    )
    print(f"{options.out}: {len(frames)} pictures, {options.out.stat().st_size / 1e6:.1f} MB")


def film(project: Project) -> Iterator[Captioned]:
    """Captions and pictures (H, W, 3) uint8, `RATE_HZ` of them per second."""
    twin: Any = project.build("twin/laptop_scene", "reference/laptop_scene:capture", "objects", "scene").artifact
    task: Any = project.build("task/close_laptop", "task", "reference", "episodes", "act_reference").artifact
    photograph, objects = twin("reference/laptop_scene:capture").photograph, twin("objects")
    yield from (("1  One photograph with depth", photograph.rgb.pixels) for _ in range(12))
    yield from (("2  Objects", masked) for masked in _masked(photograph.rgb.pixels, objects))
    turns = np.radians(50) * np.sin(np.linspace(0, 2 * np.pi, 40))
    seen = around(twin("scene"), turns, WIDTH_PX)
    yield from (("3  The twin, with collision, joints and mass", picture) for picture in seen)
    episodes, tried = task("episodes"), task("act_reference")
    parts = (
        ("4  A demonstration, one of 100, in the twin", task("task"), episodes),
        ("5  The trained policy, outside the twin (simulated)", task("reference"), tried.examples),
    )
    for caption, bundle, shown in parts:
        episode = next(episode for episode in shown.items.values() if episode.success)
        rows = np.arange(0, len(episode.action), max(1, round(shown.rate_hz / RATE_HZ)))
        pictures = Stills(bundle, None, WIDTH_PX).at(episode, rows)
        yield from ((caption, picture) for picture in [*pictures, *[pictures[-1]] * 6])


def _masked(rgb: np.ndarray, objects: Segmentation) -> Iterator[np.ndarray]:
    """The photograph with one more object in colour after the other."""
    picture = rgb.copy()
    for colour, name in zip(np.tile(COLOURS, (4, 1)), objects.names, strict=False):
        mask = objects.mask(name)
        picture[mask] = (0.45 * picture[mask] + 0.55 * colour).astype(np.uint8)
        yield from [picture.copy()] * 4
    yield from [picture] * 4


def _captioned(caption: str, picture: np.ndarray) -> np.ndarray:
    height = WIDTH_PX * 3 // 4
    small = cv2.resize(picture, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    page = Image.new("RGB", (WIDTH_PX, height + 34), "white")
    page.paste(Image.fromarray(small), (0, 0))
    ImageDraw.Draw(page).text((10, height + 7), caption, fill=(30, 30, 30), font=ImageFont.load_default(size=17))
    return np.asarray(page)


if __name__ == "__main__":
    main()
