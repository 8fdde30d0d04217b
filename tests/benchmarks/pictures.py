"""Print the sizes of real objects from photographs whose depth was left out.

    python -m tests.benchmarks.pictures

The camera's tilt is that of the support in the depth, as a level would give it; one edge of each object is stated, the
longest, and the others are compared with the ruler, or with the twin from the depth where no ruler was laid on. Boxes
around the objects are stated below. The captures lie outside the project.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Element, Elements, Shape
from dextera_build.testing import RuleRunner
from tests import factories
from tests.rules.factorize.masks.outlines import CAPTURES

THINGS: dict[str, tuple[str, tuple[int, int, int, int], tuple[float, ...]]] = {
    "table_mustard": ("mustard bottle", (345, 85, 490, 348), (58, 95, 190)),
    "table_cheezit": ("cracker box", (352, 43, 517, 336), (60, 158, 210)),
    "table_sugar": ("sugar box", (337, 86, 462, 337), (38, 89, 175)),
    "table_blue_mug": ("blue mug", (264, 160, 428, 330), ()),
    "table_white_bowl": ("white bowl", (281, 222, 462, 345), ()),
}
"""Capture -> phrase, box [px], edges by the ruler [mm] in rising order, or none."""


def main() -> None:
    """One row per photograph."""
    print("| capture | body | mask IoU | edges [mm] | compared with | edges [mm] | 90 % of the size | largest error |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        for capture, (phrase, box, ruler) in THINGS.items():
            if (CAPTURES / capture).is_dir():
                print(_row(runner, capture, phrase, box, np.array(ruler)))


def _row(runner: RuleRunner, capture: str, phrase: str, box: tuple[int, int, int, int], ruler: np.ndarray) -> str:
    files = {name: (CAPTURES / capture / name).read_bytes() for name in ("rgb.png", "depth.png", "capture.json")}
    shot = factories.shot(runner.run("capture.folder", folder=Folder(files=files)))
    measured = runner.run("align.support", **shot)
    down = -measured.camera_pose.matrix[2, 2]
    photograph = shot["photograph"]
    support = runner.run(
        "align.support", photograph=photograph, options={"pitch_deg": float(np.degrees(np.arcsin(down)))}
    )
    told = Elements(elements=(Element(name="thing", category="object", phrase=phrase, box=box),), source="scene.yaml")
    seen = runner.run(
        "factorize.segment", backend="grabcut", photograph=photograph, elements=told, support=support
    ).items["thing"]
    alone = runner.run("factorize.mesh", backend="silhouette", view=seen.view, support=support)
    name = "ruler"
    if not len(ruler):
        name, ruler = "twin from depth", _edges(_from_depth(runner, shot, measured, told))
    edges = _edges(alone)
    edges = edges * ruler[-1] / edges[-1]
    sigma = 100 * 1.645 * (alone.size_sigma or 0.0)
    worst = float(np.abs(edges - ruler)[:-1].max())
    words = [" x ".join(f"{edge:.0f}" for edge in values) for values in (edges, ruler)]
    return (
        f"| {capture} | {alone.hypothesis} | {alone.mask_iou:.2f} | {words[0]} | {name} | {words[1]} | "
        f"± {sigma:.0f} % | {worst:.1f} mm |"
    )


def _from_depth(runner: RuleRunner, shot: dict, support: object, told: Elements) -> Shape:
    elements = runner.run("factorize.parse", **shot, support=support)
    objects = runner.run("factorize.segment", **shot, support=support, elements=elements).items
    ((_, thing),) = [max(objects.items(), key=lambda item: int(item[1].view.mask.sum()))]
    shape: Shape = runner.run("factorize.mesh", view=thing.view, measured=thing.measured)
    return shape


def _edges(shape: Shape) -> np.ndarray:
    """Edges of the smallest upright box, rising [mm]."""
    return np.sort(1000 * np.asarray(shape.mesh.extent, np.float64))


if __name__ == "__main__":
    main()
