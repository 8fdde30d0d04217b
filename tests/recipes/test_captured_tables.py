"""Twins of photographs: every body stays where the photograph has it, in stock MuJoCo, from keyframe 0.

The real captures lie outside the project, and their tests are skipped by name without them; three synthetic ones, that
broke former rules, lie beside this file. `HELD` says how many bodies of a scene `simulate.steady` holds, which cannot
move. Where objects were removed the surface goes on.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.api import Project
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.scenes.scene import Background, Scene
from dextera_build.sim.worlds.settle import penetrations
from tests.benchmarks import fills
from tests.e2e.space import Space

CAPTURES, DRAWN = Path(__file__).parents[3] / "shared" / "captures", Path(__file__).parent / "captures"
TABLES = (
    *("table_top_0", "table_top_2", "table_top_5", "table_top_7"),
    *("table_mustard", "table_blue_mug", "table_white_bowl", "table_cheezit", "table_sugar"),
    "kitchen_table",
    *("clutter_test_46", "clutter_test_51", "clutter_learn_22", "clutter_learn_31"),
)
FAULTS = {"crowded_tray": 24, "second_table": 2, "fill_under_slab": 4}
"""Synthetic photographs that broke former rules: a table whose plane is seen in pieces, furniture on another level and
a fill without depth; and how many bodies their twins have."""
FLOATS = "white_box"
"""The slab of `fill_under_slab`: its visible faces end some 5 cm above the wood that is seen right below them."""
HELD = {"clutter_test_46": 1, "clutter_test_51": 1, "clutter_learn_22": 1}
"""A shape overlaps the box beside it by 40 mm, a box leans on two things whose tops are hidden by it, and the middle
one of three boxes is carried by a part of the lowest that nobody sees."""
MOST_BARE, BARE = 0.01, {"table_cheezit": 0.031}
"""Part of the fill without depth: the limit, and what is known to be missed. Behind the upper part of that carton
nothing was measured on either side, and nothing beside it tells that a surface goes on."""
SECONDS = 5.0
"""Simulated time [s]."""
MOST_DRIFT_M, MOST_DEPTH_M, MOST_TILT_RAD = 0.005, 0.0005, 0.05
"""What a body may move, be inside another at rest, and turn."""


def assert_rests(path: Path, held: int) -> None:
    """All but `held` bodies of a scene are free, and stay where keyframe 0 has them."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    free = [int(body) for body in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]]
    assert len(roots) - len(free) <= held
    places, turns = data.xpos.copy(), data.xquat.copy()
    while data.time < SECONDS:
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert np.isfinite(data.qpos).all()
    assert not any(data.warning[kind].number for kind in range(len(data.warning)))
    deep = penetrations(model, data)
    for body in free:
        label = model.body(body).name
        assert np.linalg.norm(data.xpos[body] - places[body]) < MOST_DRIFT_M, label
        cosine = min(1.0, abs(float(data.xquat[body] @ turns[body])))
        assert 2.0 * np.arccos(cosine) < MOST_TILT_RAD, label
        assert deep.get(body, 0.0) < MOST_DEPTH_M, label


def built(space: Space, address: str, *arguments: str) -> dict[str, Path]:
    """Target -> its file, of a build with real backends."""
    space.write("dxb.toml", 'cache = "cache"\n')
    answer = space.dxb("build", address, "--console", "none", *arguments, timeout_s=1800.0)
    assert answer.code == 0, answer.err
    return {name: space.root / path for name, path in (line.split("\t") for line in answer.out.splitlines())}


def assert_surfaces_go_on(space: Space, name: str, capture: Path) -> None:
    """Hardly a pixel is without depth where objects were removed, as `tests.benchmarks.fills` counts them."""
    nodes = ("photo", "corrected", "background")
    run = Project.find(space.root).build("twin/tabletop", *nodes, inputs={"capture": str(capture)})
    photo, objects, background = (run.artifact(node) for node in nodes)
    assert isinstance(photo, Capture)
    assert isinstance(objects, Segmentation)
    assert isinstance(background, Background)
    bare = fills.measured(background, photo.photograph.rgb.pixels, objects.map.labels > 0).bare
    assert bare <= MOST_BARE or bare == pytest.approx(BARE.get(name, 0.0), abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_a_photographed_table_rests(name: str, tmp_path: Path) -> None:
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    space = Space(tmp_path)
    files = built(space, "twin/tabletop:scene", "--input", f"capture={CAPTURES / name}")
    assert_rests(files["scene"], HELD.get(name, 0))
    assert_surfaces_go_on(space, name, CAPTURES / name)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_what_broke_former_rules_is_built_and_rests(name: str, tmp_path: Path) -> None:
    space = Space(tmp_path)
    files = built(space, "twin/tabletop", "--input", f"capture={DRAWN / name}")
    floating = {FLOATS} if name == "fill_under_slab" else set()
    assert_rests(files["scene"], len(floating))
    scene = Project.find(tmp_path).get("twin/tabletop:scene", inputs={"capture": str(DRAWN / name)})
    assert isinstance(scene, Scene)
    assert set(scene.held) == floating
    assert all(why.startswith("nothing carries it: it would fall by ") for why in scene.held.values())
    assert len(scene.bodies) + len(scene.held) == FAULTS[name]
    assert_surfaces_go_on(space, name, DRAWN / name)
