"""A run whose types have other fields today: listed, shown and compared.

`run_of_version_1.tar.gz` is the store of a project in which an earlier dxb built one node, a `Support`.
"""

from __future__ import annotations

import tarfile
from pathlib import Path

import pytest

from dextera_build.artifacts.core.identity import spelled
from dextera_build.artifacts.objects.object import Support
from dextera_build.runs.history import History
from dextera_build.store.store import Store
from tests.e2e.space import Space

RULE = '''
"""lab.look: a support as one saw it."""
import numpy as np
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import Context, rule

@rule(version=1)
def look(ctx: Context) -> Support:
    """Return a support."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    camera_pose = Pose(parent="world", child="camera", matrix=np.eye(4))
    return Support(camera_pose=camera_pose, polygon=corners, residual_m=0.002, inlier_fraction=0.5)
'''


@pytest.fixture
def space(tmp_path: Path) -> Space:
    space = Space(tmp_path)
    with tarfile.open(Path(__file__).with_name("run_of_version_1.tar.gz")) as archive:
        archive.extractall(tmp_path, filter="data")
    # The history is kept by project folder.
    store = Store(tmp_path / "cache")
    history = History(store, "lab/scene", str(tmp_path))
    for node, entry in History(store, "lab/scene", "/srv/lab").all().items():
        history.note(node, entry)
    history.save()
    space.write("dxb.toml", "")
    space.write("rules/lab/look.py", RULE.lstrip())
    space.write("recipes/lab/scene.yaml", "nodes: {look: {rule: lab.look}}")
    return space


def test_it_is_listed_and_shown(space: Space) -> None:
    assert "lab/scene" in space.dxb("ls", "runs").out
    assert "look\tran" in space.dxb("log", "0001").out
    shown = space.dxb("show", "lab/scene:look").out
    assert "type\tSupport\n" in shown
    assert "field world_from_camera\tfloat64 (4, 4)" in shown
    assert space.dxb("report", "0001", "-o", "page.html").code == 0


def test_it_is_compared_with_a_run_of_today(space: Space) -> None:
    assert space.dxb("build", "lab/scene").code == 0
    assert f"type\t{spelled(Support)}\n" in space.dxb("show", "lab/scene:look").out
    rows = space.dxb("diff", "0001", "0002", "--json").out
    assert "world_from_camera" in rows
    assert "residual_m" in rows
