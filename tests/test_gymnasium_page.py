"""The code of the page about Gymnasium runs as it stands there, in a program of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.tasks.task import Reset
from tests import task_bundles

REPO = Path(__file__).parent.parent
PAGE = REPO / "dextera_build" / "docs" / "gymnasium.md"
HEAVY = ("torch", "open3d", "trimesh", "cv2", "pycolmap", "mink", "pyarrow", "pxr")
"""Packages that the extra `env` does not bring."""


def test_the_code_of_the_page_runs_without_other_extras(tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    bundle = task_bundles.lift(reset=Reset(position_m=0.03, joints=1.0))
    (tmp_path / "bundles").mkdir()
    (tmp_path / "bundles" / "LiftBlueMug-KL-v0.bundle").write_bytes(pack(bundle))
    trees.write(bundle.model.files, tmp_path / "lift")
    forbid = f"import sys\nsys.modules.update(dict.fromkeys({HEAVY!r}))\n"
    environment = {**os.environ, "PYTHONPATH": str(REPO)}
    done = subprocess.run(
        [sys.executable, "-c", forbid + "\n".join(blocks)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    first, second, third, fourth, fifth = done.stdout.splitlines()
    assert first.startswith("(2, 7) ")
    assert second == "('x.delta', 'y.delta', 'z.delta', 'left.delta', 'right.delta')"
    assert third.startswith("-1.0 1.0 (")
    assert fourth == "{'agent_pos': (5,), 'environment_state': (14,)}"
    assert fifth == "(96, 128, 3) (96, 128, 3)"
