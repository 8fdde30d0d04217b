"""Print how the masks of drawn photographs compare with the truth, before any body is made.

    make meshes
    python -m tests.benchmarks.drawn_masks --scenes 20 --views 2

The scenes are those of `benchmark/stage_one`, or of `benchmark/learn` where limits are chosen.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.artifacts.table import Table
from dextera_build.geometry import metrics
from rules.benchmark.instances import overlaps
from tests.benchmarks import catalogue

FOUND = 0.5
"""Mask IoU from which an object counts as found."""
PURE = 0.6
"""An object is merged with another if its best mask has less than this fraction of its pixels on it."""


@dataclass(frozen=True)
class Judged:
    """The masks of one photograph beside its truth."""

    iou: dict[str, float]
    """Expected object -> IoU of its mask; 0 for a missed one."""
    kinds: dict[str, str]
    """Missed object -> `merged`, `split` or `nothing`."""
    spurious: int
    """Masks that match no true object."""


def judge(true: np.ndarray, names: dict[str, int], expected: set[str], shown: np.ndarray, count: int) -> Judged:
    """Pair masks 1..count of `shown` (H, W) with the objects of `true` (H, W) one to one."""
    known = [name for name, label in names.items() if (true == label).any()]
    matrix = overlaps(true, [names[name] for name in known], shown, count)
    pairs = {known[row]: (row, column) for row, column in metrics.match(matrix, FOUND)}
    iou = {name: float(matrix[pairs[name]]) if name in pairs else 0.0 for name in known if name in expected}
    kinds = {name: _kind(shown, true == names[name]) for name in iou if name not in pairs}
    return Judged(iou, kinds, count - len(pairs))


def _kind(shown: np.ndarray, own: np.ndarray) -> str:
    counts = np.bincount(shown[own], minlength=2)[1:]
    if counts.sum() < 0.3 * own.sum():
        return "nothing"
    best = int(counts.argmax())
    return "merged" if counts[best] < PURE * (shown == best + 1).sum() else "split"


def judged(recipe: str, meshes: Path, first: int, count: int, views: int) -> list[Judged]:
    """Every photograph of these scenes; one without masks misses all its objects."""
    project = Project.find(catalogue.REPO)
    settings = {"draws.scenes": count, "draws.first": first, "draws.views": views}
    labels = [f"scene[{scene:04d}_{view}]" for scene in range(first, first + count) for view in range(views)]
    wanted = [f"{label}.{node}" for label in labels for node in ("truth", "counted", "twin/objects")]
    built = project.build(recipe, *wanted, inputs={"meshes": meshes}, settings=settings, keep_going=True)
    found = []
    for label in labels:
        if any(built.nodes[f"{label}.{node}"].output is None for node in ("truth", "counted")):
            continue
        truth, counted = (built.artifact(f"{label}.{node}") for node in ("truth", "counted"))
        assert isinstance(truth, Truth)
        assert isinstance(counted, Table)
        shown, masks = np.zeros(truth.labels.labels.shape, np.int32), 0
        if built.nodes[f"{label}.twin/objects"].output is not None:
            objects = built.artifact(f"{label}.twin/objects")
            assert isinstance(objects, Segmentation)
            shown, masks = objects.map.labels, len(objects.names)
        names = {name: thing.label for name, thing in truth.objects.items()}
        found.append(judge(truth.labels.labels, names, {str(row[0]) for row in counted.rows}, shown, masks))
    return found


def main() -> None:
    """One line with 95 % bootstrap intervals over objects."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--recipe", default="benchmark/stage_one")
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--first", type=int, default=0, help="index of the first scene")
    options.add_argument("--scenes", type=int, default=20, help="number of scenes")
    options.add_argument("--views", type=int, default=2, help="photographs of each")
    given = options.parse_args()
    told = judged(given.recipe, given.meshes, given.first, given.scenes, given.views)
    iou = np.array([value for one in told for value in one.iou.values()])
    draws = iou[np.random.default_rng(0).integers(0, len(iou), (2000, len(iou)))]
    for name, value, drawn in (
        ("found", (iou >= FOUND).mean(), (draws >= FOUND).mean(axis=1)),
        ("mask IoU", iou.mean(), draws.mean(axis=1)),
    ):
        low, high = np.quantile(drawn, (0.025, 0.975))
        print(f"{name} {value:.3f} [{low:.3f}, {high:.3f}] of {len(iou)} objects")
    kinds = Counter(kind for one in told for kind in one.kinds.values())
    print(f"spurious {sum(one.spurious for one in told)}; missed {dict(kinds)}")


if __name__ == "__main__":
    main()
