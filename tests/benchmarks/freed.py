"""Print which bodies of twins of photographs stay at rest when all of them are free.

    python -m tests.benchmarks.freed [CAPTURE ...]

Without names, all photographs with depth that lie outside the project. Each twin is built by `twin/tabletop` without
options. *Held* are bodies that the build fixes, with their causes; here they are freed as well, and the scene runs for
5 s in stock MuJoCo from keyframe 0: *at rest* are bodies that moved by less than 5 mm and turned by less than 10 deg.
*No depth* is the part of the fill, in which objects were removed, without a surface, as in `tests.benchmarks.fills`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.scenes.scene import Background, Scene
from dextera_build.errors import DxbError
from dextera_build.sim.worlds.settle import let_go
from tests.benchmarks.fills import measured, photographs

SECONDS = 5.0
"""Simulated time [s]."""
MOST_DRIFT_M, MOST_TILT_RAD = 0.005, np.radians(10.0)
"""What a body at rest moves and turns at most."""


def row(project: Project, path: Path) -> str:
    """One row of the table."""
    nodes = ("photo", "corrected", "background", "composed", "scene")
    built = project.build("twin/tabletop", *nodes, inputs={"capture": str(path)})
    photo, objects, background, composed, scene = (built.artifact(name) for name in nodes)
    assert isinstance(photo, Capture)
    assert isinstance(composed, Scene)
    assert isinstance(scene, Scene)
    assert isinstance(background, Background)
    assert isinstance(objects, Segmentation)
    run = let_go(composed.model, composed.bodies, SECONDS)
    rests = [each.drift_m < MOST_DRIFT_M and each.tilt_rad < MOST_TILT_RAD for each in run.motions]
    moved = [each.name for each, still in zip(run.motions, rests, strict=True) if not still]
    drift = max((each.drift_m for each, still in zip(run.motions, rests, strict=True) if still), default=0.0)
    bare = measured(background, photo.photograph.rgb.pixels, objects.map.labels > 0).bare
    held = "; ".join(f"{name}: {why}" for name, why in scene.held.items()) or "-"
    counts = f"{len(rests)} | {len(scene.held)} | {sum(rests) if not run.diverged else 0}"
    return f"| {path.name} | {counts} | {1000 * drift:.1f} | {100 * bare:.2f} | {', '.join(moved) or '-'} | {held} |"


def main() -> None:
    """One row per photograph."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("captures", nargs="*", metavar="NAME", help="folder in the folder of captures; default: all")
    asked.add_argument("--cache", help="store of the builds; default: a new one")
    options = asked.parse_args()
    print("| photograph | bodies | held | at rest | largest drift [mm] | no depth [%] | moved | held, and why |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        project = Project.find(folder, cache=options.cache or str(Path(folder) / "cache"))
        for path in photographs(options.captures):
            try:
                print(row(project, path.resolve()), flush=True)
            except DxbError as error:
                print(f"| {path.name} | {error} | | | | | | |", flush=True)


if __name__ == "__main__":
    main()
