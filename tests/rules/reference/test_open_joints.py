"""reference.open_joints: the parts of a hinge elsewhere, everything else as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.scenes.world import World
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

BLOCKS = {
    "base": {"size_m": [0.10, 0.02, 0.02]},
    "arm": {"size_m": [0.10, 0.02, 0.02], "at_m": [0.05, 0.0, 0.02], "turn_deg": [0, 0, 30]},
}
HINGE = {"parts": ["arm"], "origin_m": [0.05, 0, 0], "axis": [0, 0, 1], "range_deg": [0, 90]}


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    runner = RuleRunner(tmp_path_factory.mktemp("world"))
    thing = {"kind": "assembly", "mass_kg": 0.1, "blocks": BLOCKS, "at_m": [0.0, 0.0], "seed": 1}
    tongs = {**thing, "moves": {**HINGE, "position_deg": 30.0, "mass_kg": 0.05}}
    block = {**thing, "blocks": {"one": BLOCKS["base"]}, "at_m": [0.3, 0.0]}
    options = {
        "camera": {"eye_m": [0.0, -0.6, 0.6], "target_m": [0.0, 0.0, 0.0]},
        "objects": {"tongs": tongs, "block": block},
        "lamps": [{"direction": [0, 0, -1], "strength": 0.5}],
    }
    made: World = runner.run("reference.world", options=options)
    return made


@pytest.mark.medium
def test_the_parts_turn_about_the_axis_and_nothing_else_moves(runner: RuleRunner, world: World) -> None:
    moved = runner.run("reference.open_joints", world=world, options={"positions_deg": {"tongs": 75.0}})
    before, after = world.objects["tongs"], moved.objects["tongs"]
    assert after.hinge.position == pytest.approx(np.radians(75.0))
    assert np.array_equal(after.parts["base"].mesh.vertices, before.parts["base"].mesh.vertices)
    turn, origin = np.radians(45.0), np.array([0.05, 0.0, 0.0])
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    for one, other in (
        (before.parts["arm"].mesh.vertices, after.parts["arm"].mesh.vertices),
        (before.parts["arm"].pieces[0].vertices, after.parts["arm"].pieces[0].vertices),
    ):
        assert other == pytest.approx((one - origin) @ rotation.T + origin, abs=1e-6)
    assert after.surface.is_closed
    other, same = moved.objects["block"].parts["one"].mesh, world.objects["block"].parts["one"].mesh
    assert np.array_equal(other.vertices, same.vertices)
    assert np.array_equal(moved.camera_pose.matrix, world.camera_pose.matrix)


def test_back_again_is_the_same_world(runner: RuleRunner, world: World) -> None:
    there = runner.run("reference.open_joints", world=world, options={"positions_deg": {"tongs": 80.0}})
    back = runner.run("reference.open_joints", world=there, options={"positions_deg": {"tongs": 30.0}})
    arm = world.objects["tongs"].parts["arm"].mesh.vertices
    assert back.objects["tongs"].parts["arm"].mesh.vertices == pytest.approx(arm, abs=1e-6)


@pytest.mark.parametrize(
    ("positions", "told"),
    [
        ({"tong": 40.0}, "no object `tong`"),
        ({"block": 40.0}, "no object `block`"),
        ({"tongs": 95.0}, "does not go to 95"),
    ],
)
def test_what_cannot_be_is_refused(runner: RuleRunner, world: World, positions: dict[str, float], told: str) -> None:
    with pytest.raises(RuleError, match=told):
        runner.run("reference.open_joints", world=world, options={"positions_deg": positions})
