"""Draw photographs beside their twins, which are seen from the photograph's camera and from both sides of it.

    python -m tests.benchmarks.twin_pictures OUT.jpg NAME...

A row per photograph of the folder of captures, built by `twin/tabletop` without options: the photograph, the twin from
its camera, and from that camera turned by 60 deg to the left and to the right about the middle of the objects; of one
photograph alone two rows. Prints a table of what each twin holds. The captures lie outside the project; some may not be
redistributed, so their pictures may not either.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import mujoco
import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.scenes.scene import Scene, SettleReport
from dextera_build.sim.model import model as models
from dextera_build.sim.render.rendering import Eye
from tests.rules.factorize.masks.outlines import CAPTURES

TURNS_DEG = (0.0, -60.0, 60.0)
WIDTH_PX = 400
"""Width of one picture of a row."""


def row(scene: Scene, photograph: np.ndarray) -> np.ndarray:
    """The photograph (H, W, 3) uint8 and the twin's views, side by side."""
    views = list(around(scene, np.radians(TURNS_DEG), WIDTH_PX))
    height = len(views[0])
    return np.hstack([cv2.resize(photograph, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), *views])


def stacked(rows: list[np.ndarray]) -> np.ndarray:
    """The rows below one another; one alone is folded in the middle."""
    return np.vstack(rows if len(rows) > 1 else np.hsplit(rows[0], 2))


def around(scene: Scene, turns: np.ndarray, width_px: int) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8 from the photograph's camera, turned by `turns` [rad] about the middle of the bodies."""
    model = models.compile_folder(scene.model)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    middle = np.mean([data.body(name).xpos for name in scene.bodies], axis=0)
    camera = scene.camera.scaled(width_px / scene.camera.width)
    for turn in turns:
        turned = np.eye(4)
        turned[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        turned[:3, 3] = middle - turned[:3, :3] @ middle
        with Eye(model, camera, turned @ scene.camera_pose.matrix) as eye:
            yield eye.rgb(data)


def main() -> None:
    """Build the twins, print their table and write the picture."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("out", type=Path)
    asked.add_argument("captures", nargs="+", metavar="NAME", help="folder in the folder of captures, or a path")
    options = asked.parse_args()
    rows = []
    print("| photograph | bodies | free | at rest | held, and why |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        project = Project.find(folder, cache=str(Path(folder) / "cache"))
        for name in options.captures:
            capture = (Path(name) if Path(name).is_dir() else CAPTURES / name).resolve()
            built = project.build("twin/tabletop", "scene", "settle", inputs={"capture": str(capture)})
            scene, settled = built.artifact("scene"), built.artifact("settle")
            assert isinstance(scene, Scene)
            assert isinstance(settled, SettleReport)
            count = len(scene.bodies) + len(scene.held)
            resting = sum(body.resting for body in settled.bodies)
            held = "; ".join(f"{body}: {why}" for body, why in scene.held.items()) or "-"
            print(f"| {capture.name} | {count} | {len(scene.bodies)} | {resting} | {held} |")
            photograph = cv2.cvtColor(cv2.imread(str(capture / "rgb.png")), cv2.COLOR_BGR2RGB)
            rows.append(row(scene, photograph))
    cv2.imwrite(str(options.out), cv2.cvtColor(stacked(rows), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
