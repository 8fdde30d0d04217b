"""Objects of unknown unit and frame, placed: `python -m tests.benchmarks.registration --meshes FOLDER --count 120`.

Foreign meshes stand or lie on a table, half of them behind another thing. A depth camera's faults are on depth, colour
and mask. The asset is the true mesh, turned by a random rotation, moved, and in a unit of 0.1 to 10 metres. It is
placed by `align.object` (backend `icp`), by boxes, and by Open3D's ICP with scaling; the last gets the 24 axis
rotations and the scale of the boxes, or the same starts as `align.object`, and chooses by fitness.

Errors: distance of the surface's centroid; angle over the rotational symmetries of the mesh; log of the scale; ADD-S.
Intervals are 90 % of bootstrap medians. Times are processor time of one thread. One JSON line per view and method,
then a table.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.geometry.registration import ScaledPose
from rules.align.object import object_icp
from rules.align.object.icp_options import IcpOptions
from rules.align.object.object import ObjectOptions, misfit

from . import baselines, judged, scenes
from .scenes import Known


def ours(known: Known) -> dict[str, Any]:
    """By backend `icp` of align.object, with its verdict."""
    context: Any = None  # the backend asks nothing of it
    placed = object_icp.place(context, known.asset, known.seen, ObjectOptions(), IcpOptions())
    placement = placed.placement
    return {
        "found": ScaledPose(placement.scale, placement.pose.matrix),
        "refused": misfit(placed, ObjectOptions()),
        "ambiguous": placement.ambiguous,
        "how": placement.method,
        "iou": placed.iou,
        "violation": placed.violation,
        "covariance": placement.pose.covariance,
        "scale_sigma": placement.scale_sigma,
    }


METHODS: dict[str, Callable[[Known], dict[str, Any]]] = {
    "align.object": ours,
    "bounding boxes": lambda known: {"found": baselines.bounding_box(known)},
    "Open3D ICP, model to view": lambda known: {"found": baselines.open3d_icp(known)},
    "Open3D ICP, view to model": lambda known: {"found": baselines.open3d_icp(known, backwards=True)},
    "Open3D ICP, view to model, our starts": lambda known: {
        "found": baselines.open3d_icp(known, backwards=True, ranked=True)
    },
    "Open3D ICP, model to view, our starts": lambda known: {"found": baselines.open3d_icp(known, ranked=True)},
}


def rows(draws: Iterator[Known], methods: list[str]) -> Iterator[dict[str, Any]]:
    """Every view by every method."""
    for known in draws:
        truth = judged.truth(known)
        for method in methods:
            start = time.process_time()
            made = METHODS[method](known)
            seconds = time.process_time() - start
            placed = made.pop("found")
            error = judged.error(truth, placed)
            if (covariance := made.pop("covariance", None)) is not None:
                made["sigmas"] = np.sqrt(np.diag(covariance)).tolist()
                made["surprise"] = judged.surprise(truth, placed, covariance)
            row = {"object": known.name, "method": method, "visible": known.visible, "seconds": seconds}
            row["distance"] = known.distance
            yield row | vars(error) | made | {"symmetry": str(truth.symmetry)}


def table(found: list[dict[str, Any]]) -> str:
    """Medians with 90 % intervals; those of what was refused count as well."""
    head = "| method | n | refused | centre, mm | turn, deg | scale, % | ADD-S, mm | within 5 mm, 3 deg, 2 % | s |"
    lines = [head, "|" + "---|" * 9]
    for method in dict.fromkeys(row["method"] for row in found):
        mine = [row for row in found if row["method"] == method]
        refused = sum(bool(row.get("refused")) for row in mine)
        move, turn, adds = (np.array([row[key] for row in mine]) for key in ("move_m", "turn_deg", "adds_m"))
        scale = np.abs(np.array([row["scale"] for row in mine]))
        good = (move < 0.005) & (turn < 3.0) & (scale < 0.02)
        cells = [_median(1000 * move), _median(turn), _median(100 * scale), _median(1000 * adds)]
        seconds = np.median([row["seconds"] for row in mine])
        lines.append(
            f"| {method} | {len(mine)} | {refused} | {' | '.join(cells)} | {good.mean():.0%} | {seconds:.2f} |"
        )
    return "\n".join(lines)


def _median(values: np.ndarray) -> str:
    random = np.random.default_rng(0)
    again = np.median(random.choice(values, (2000, len(values))), axis=1)
    low, high = np.quantile(again, [0.05, 0.95])
    return f"{np.median(values):.3g} ({low:.3g}-{high:.3g})"


def main() -> None:
    """Draw, place, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, required=True, help="the folder that `make meshes` writes")
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--distance", type=float, nargs=2, default=(0.45, 1.0), help="of the camera, from and to [m]")
    parser.add_argument("--noise", type=float, default=1.0, help="times the noise of the depth")
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=list(METHODS))
    arguments = parser.parse_args()
    library = scenes.things(arguments.meshes, Path(tempfile.mkdtemp()))
    found = []
    how = scenes.Conditions(*arguments.distance, arguments.noise)
    for row in rows(scenes.draws(library, arguments.count, arguments.seed, how), arguments.methods):
        print(json.dumps(row), file=sys.stderr, flush=True)
        found.append(row)
    print(table(found))


if __name__ == "__main__":
    main()
