"""Print how the direction up by upright edges compares with the support's normal in the depth.

    python -m tests.benchmarks.upright_edges [CAPTURE ...]

Without names, all photographs with depth that lie outside the project, as they are and turned by 90, 180 and 270 deg.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.errors import DxbError
from dextera_build.testing import RuleRunner
from rules.align.support import uprights
from tests import factories
from tests.benchmarks.fills import photographs


def main(names: list[str]) -> None:
    """One row per photograph in which upright edges tell the direction up."""
    print("| photograph | edges | error [deg] |\n|---|---|---|")
    count, turned = 0, 0
    for path in photographs(names):
        with tempfile.TemporaryDirectory() as folder:
            runner = RuleRunner(Path(folder))
            files = {file.name: file.read_bytes() for file in path.iterdir() if file.is_file()}
            try:
                shot = factories.shot(runner.run("capture.folder", folder=Folder(files=files)))
                support = runner.run("align.support", **shot)
            except DxbError as error:
                print(f"| {path.name} | {error} | |", flush=True)
                continue
        photograph, count = shot["photograph"], count + 1
        pixels, k = photograph.rgb.pixels, photograph.camera.matrix()
        found = uprights.find(pixels, k)
        if found is not None:
            cosine = float(found.direction @ support.camera_pose.matrix[2, :3])
            print(f"| {path.name} | {found.lines} | {np.degrees(np.arccos(min(cosine, 1.0))):.1f} |", flush=True)
        for turns in (1, 2, 3):
            other = photograph.camera.turned(turns).matrix()
            turned += uprights.find(np.ascontiguousarray(np.rot90(pixels, turns)), other) is not None
    print(f"\n{count} photographs; of {3 * count} turned ones, {turned} have a direction, which is wrong")


if __name__ == "__main__":
    main(sys.argv[1:])
