"""Twins of real photographs: every body stays where the photograph has it, in stock MuJoCo, from keyframe 0.

The captures lie outside the project, and the tests are skipped by name without them. `HELD` says how many bodies of a
scene `simulate.steady` holds, which cannot move.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.sim.worlds.settle import penetrations
from tests.e2e.space import Space

CAPTURES = Path(__file__).parents[3] / "shared" / "captures"
TABLES = (
    *("table_top_0", "table_top_2", "table_top_5", "table_top_7"),
    *("table_mustard", "table_blue_mug", "table_white_bowl", "table_cheezit", "table_sugar"),
    "kitchen_table",
    *("clutter_test_46", "clutter_test_51", "clutter_learn_22", "clutter_learn_31"),
)
HELD = {"clutter_test_46": 1, "clutter_test_51": 1, "clutter_learn_22": 1}
"""A shape overlaps the box beside it by 40 mm, a box leans on two things whose tops are hidden by it, and the middle
one of three boxes is carried by a part of the lowest that nobody sees."""
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


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_a_photographed_table_rests(name: str, tmp_path: Path) -> None:
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    files = built(Space(tmp_path), "twin/tabletop:scene", "--input", f"capture={CAPTURES / name}")
    assert_rests(files["scene"], HELD.get(name, 0))
