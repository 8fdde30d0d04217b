"""Objects of captured photographs, outlined by hand, and how masks compare with them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.testing import RuleRunner
from rules.benchmark.instances import assign, overlaps
from tests import factories

CAPTURES = Path(__file__).parents[5] / "shared" / "captures"
FILE = Path(__file__).with_name("outlines.yaml")
FOUND = 0.5
"""IoU from which an object counts as found."""


@dataclass(frozen=True)
class Judged:
    """The masks of one photograph beside its outlines."""

    iou: dict[str, float]
    """Object -> IoU of the instance that is paired with it; 0 without one."""
    spurious: tuple[str, ...]
    """Instances without a partner."""
    in_pieces: tuple[str, ...]
    """Objects with two or more instances that lie mostly on them and cover a twentieth of them each."""

    @property
    def missed(self) -> tuple[str, ...]:
        """Objects with an IoU below FOUND."""
        return tuple(name for name, iou in self.iou.items() if iou < FOUND)


@cache
def outlines() -> dict[str, dict[str, np.ndarray]]:
    """Capture -> object -> corners (N, 2) int32 x, y [px]."""
    known = yaml.safe_load(FILE.read_text())
    return {
        capture: {name: np.array(corners, np.int32).reshape(-1, 2) for name, corners in objects.items()}
        for capture, objects in known.items()
    }


def labels(capture: str, shape: tuple[int, int]) -> np.ndarray:
    """Labels (H, W) int32 of the outlined objects: 1.. in the order of the file, later ones in front."""
    import cv2

    drawn = np.zeros(shape, np.int32)
    for number, corners in enumerate(outlines()[capture].values(), start=1):
        cv2.fillPoly(drawn, [corners], number)
    return drawn


def segmented(runner: RuleRunner, capture: str) -> Segmentation:
    """The instances of a captured photograph, found by the default backends."""
    return over_support(runner, capture)[0]


def over_support(runner: RuleRunner, capture: str) -> tuple[Segmentation, Support]:
    """The same, and the support that they stand on."""
    files = {name: (CAPTURES / capture / name).read_bytes() for name in ("rgb.png", "depth.png", "capture.json")}
    shot = factories.shot(runner.run("capture.folder", folder=Folder(files=files)))
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    return runner.run("factorize.segment", **shot, support=support, elements=elements), support


def judge(capture: str, found: Segmentation) -> Judged:
    """Pair instances with outlined objects one to one, so that the sum of IoUs is largest."""
    shown = found.map.labels
    names, true = list(outlines()[capture]), labels(capture, shown.shape)
    numbers = list(range(1, len(names) + 1))
    matrix = overlaps(true, numbers, shown, len(found.names))
    pairs = assign(matrix)
    pieces = []
    for number, name in zip(numbers, names, strict=True):
        own = true == number
        parts = [(own & (shown == j + 1)).sum() for j in range(len(found.names))]
        sizes = [(shown == j + 1).sum() for j in range(len(found.names))]
        if sum(part > 0.5 * size and part > 0.05 * own.sum() for part, size in zip(parts, sizes, strict=True)) > 1:
            pieces.append(name)
    return Judged(
        iou={name: float(matrix[i, pairs[i]]) if i in pairs else 0.0 for i, name in enumerate(names)},
        spurious=tuple(name for j, name in enumerate(found.names) if j not in pairs.values()),
        in_pieces=tuple(pieces),
    )
