"""twin/tabletop from a folder whose `capture.json` lists further photographs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from tests import tabletops
from tests.e2e.space import Space
from tests.installed import needs
from tests.rules.test_several import motion, taken

needs("open3d", "pycolmap", "manifold3d", "mujoco")


@pytest.fixture
def space(tmp_path: Path) -> Space:
    """Three photographs: one is found by features, and the pose of the one from behind is stated."""
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    shots = {name: taken(degrees) for name, degrees in (("first", 0), ("right", 35), ("behind", -110))}
    for name, shot in shots.items():
        tabletops.write(shot.capture, tmp_path / name)
    folder = tmp_path / "first"
    listed = []
    for name in ("right", "behind"):
        entry: dict[str, object] = {"rgb": f"{name}.png", "depth": f"{name}_depth.png"}
        (tmp_path / name / "rgb.png").rename(folder / f"{name}.png")
        (tmp_path / name / "depth.png").rename(folder / f"{name}_depth.png")
        if name == "behind":
            entry["T_first_camera"] = motion(shots["first"], shots[name]).tolist()
        listed.append(entry)
    facts = json.loads((folder / "capture.json").read_text())
    (folder / "capture.json").write_text(json.dumps({**facts, "photographs": listed}))
    return made


@pytest.mark.slow
def test_a_folder_of_three_photographs_becomes_a_twin(space: Space) -> None:
    answer = space.build("twin/tabletop:scene", "--input", "capture=first")
    assert answer.code == 0, answer.err[-3000:]
    lines = {event["node"]: event["line"] for event in answer.events if event["event"] == "node_finished"}
    assert lines["listed"] == "right.png, behind.png"
    assert "behind.png" in lines["further"]
    assert lines["shown"] == "right.png shows 2 of 2; behind.png shows 2 of 2"
    meshes = [line for node, line in lines.items() if node.endswith(".mesh")]
    assert len(meshes) == 2
    assert all("behind.png shows" in line for line in meshes), meshes
    assert lines["background"].endswith("of what was hidden seen by others")


@pytest.mark.slow
def test_a_photograph_that_is_listed_twice_stops_the_build_with_its_name(space: Space) -> None:
    path = space.root / "first" / "capture.json"
    facts = json.loads(path.read_text())
    facts["photographs"].append(facts["photographs"][0])
    path.write_text(json.dumps(facts))
    answer = space.build("twin/tabletop", "--input", "capture=first")
    assert answer.code != 0
    assert "`photographs[2]` is a photograph that is there already" in answer.err + answer.out
    assert Image.open(space.root / "first" / "right.png").size == (640, 480)
