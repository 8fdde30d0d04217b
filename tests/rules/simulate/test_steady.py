"""simulate.steady: what would not rest is held, and the rest stays free."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.geometry import lie
from dextera_build.rule import Context
from dextera_build.sim.model import model as models
from dextera_build.sim.worlds.hold_unstable import _cause
from dextera_build.sim.worlds.settle import Motion
from rules.simulate.scene import settle_mujoco, steady_mujoco, steady_stub
from rules.simulate.scene.scene import scene
from rules.simulate.scene.settle import SettleOptions, settle
from rules.simulate.scene.steady import SteadyOptions, steady
from tests import factories


def placed(tmp_path: Path, **assets: Asset) -> Scene:
    found = Collection[Asset](items=assets)
    return scene(Context(scratch=tmp_path), found, factories.background(), factories.support(), factories.camera())


def made_steady(tmp_path: Path, **assets: Asset) -> tuple[Scene, Context]:
    context = Context(backend=steady_mujoco, scratch=tmp_path)
    return steady(context, placed(tmp_path, **assets), options=SteadyOptions(seconds=1.0)), context


def settles(twin: Scene, tmp_path: Path) -> bool:
    return settle(Context(backend=settle_mujoco, scratch=tmp_path), twin, options=SettleOptions(seconds=1.5)).passed


def test_a_standing_scene_stays_as_it_is(tmp_path):
    assets = {"box": factories.box_asset(), "lap": factories.laptop_asset(factories.pose(0.25, 0.1))}
    twin, context = made_steady(tmp_path, **assets)
    assert twin.model.files == placed(tmp_path, **assets).model.files
    assert twin.bodies == ("box", "lap")
    assert not context.outcome.warnings


def test_of_two_bodies_in_one_place_one_is_held_and_the_other_rests(tmp_path):
    first, second = factories.box_asset(), factories.box_asset(factories.pose(0.03))
    assert not settles(placed(tmp_path, a=first, b=second), tmp_path)
    twin, context = made_steady(tmp_path, a=first, b=second, far=factories.box_asset(factories.pose(-0.3)))
    assert len(twin.held) == 1
    assert set(twin.bodies) | set(twin.held) == {"a", "b", "far"}
    assert "far" in twin.bodies
    assert "is held where the photograph has it: it is" in context.outcome.warnings[0]
    assert settles(twin, tmp_path)
    model = models.compile_folder(twin.model)
    data = models.at_home(model)
    assert model.nq == 14
    for name, x in (("a", 0.0), ("b", 0.03), ("far", -0.3)):
        assert data.xpos[model.body(name).id][0] == pytest.approx(x, abs=1e-6), "keyframe `home` still fits"


def test_what_would_fall_is_held_and_an_articulated_neighbour_keeps_its_joint(tmp_path):
    beside = factories.box_asset(factories.pose(0.9))
    lap = factories.laptop_asset(factories.pose(0.25, 0.1))
    twin, context = made_steady(tmp_path, lost=beside, lap=lap)
    assert set(twin.held) == {"lost"}
    assert "nothing carries it: it would fall by" in context.outcome.warnings[0]
    model = models.compile_folder(twin.model)
    home, alone = models.at_home(model), models.at_home(models.compile_folder(placed(tmp_path, lap=lap).model))
    assert home.qpos == pytest.approx(alone.qpos)
    assert settles(twin, tmp_path)


def test_what_leans_on_another_one_is_held_with_its_name_and_that_the_border_cuts_it(tmp_path):
    lean = factories.pose(0.0, z=0.1)
    lean[:3, :3] = lie.rotation(np.array([0.0, np.radians(30.0), 0.0]))
    leaning = factories.box_asset(lean, size=(0.02, 0.08, 0.16)).model_copy(update={"cut": True})
    wall = factories.box_asset(factories.pose(0.085), size=(0.06, 0.1, 0.13), mass=3.0)
    twin, _ = made_steady(tmp_path, leaning=leaning, wall=wall)
    assert twin.cut == ("leaning",)
    assert set(twin.held) == {"leaning"}
    assert twin.held["leaning"].endswith(steady_mujoco.CUT)


def test_the_cause_names_what_is_touched():
    still = Motion("a", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    slides, tips, falls = (replace(still, **{name: 0.3}) for name in ("drift_m", "tilt_rad", "fall_m"))
    assert _cause(slides, {"b": 0.0, "": 0.0}) == "it would move by 300 mm: it slides off b"
    assert _cause(slides, {"": 0.0}) == "it would move by 300 mm: what carries it is hidden"
    assert _cause(tips, {"b": 0.0005}) == "it would tip over by 17 deg: it leans on b"
    assert _cause(tips, {}) == "it would tip over by 17 deg: it leans, or its lower part is hidden"
    assert _cause(falls, {}) == "nothing carries it: it would fall by 300 mm"
    assert _cause(falls, {"b": 0.001, "": 0.012}) == "it is 12 mm inside the room"


def test_neighbours_that_overlap_a_little_both_stay_free(tmp_path):
    box = factories.box_asset()
    width = float(next(iter(box.body.links.values())).mesh.extent[0])
    twin, context = made_steady(tmp_path, a=box, b=factories.box_asset(factories.pose(width - 0.003)))
    assert not twin.held
    if context.outcome.warnings:
        assert "do not collide: their shapes overlap by" in context.outcome.warnings[0]
    assert settles(twin, tmp_path)


def test_the_stub_holds_nothing(tmp_path):
    twin = placed(tmp_path, a=factories.box_asset(), b=factories.box_asset(factories.pose(0.03)))
    assert steady(Context(backend=steady_stub, scratch=tmp_path), twin, options=SteadyOptions()) == twin


def test_what_only_another_held_body_would_push_is_free_again(tmp_path):
    """A heavy box falls on a light one, which moves and is lower; once the heavy one is held, the light one rests."""
    lower = factories.box_asset(size=(0.02, 0.02, 0.12), mass=0.02)
    twin, _ = made_steady(tmp_path, lower=lower, upper=factories.box_asset(factories.pose(0.02, z=0.2), mass=2.0))
    assert set(twin.held) == {"upper"}
    assert settles(twin, tmp_path)


def test_what_stands_on_a_body_that_is_held_stays_free(tmp_path):
    lower, upper = factories.box_asset(factories.pose(0.0, z=0.05)), factories.box_asset(factories.pose(0.0, z=0.26))
    twin, context = made_steady(tmp_path, lower=lower, upper=upper)
    assert set(twin.held) == {"lower"}
    assert twin.bodies == ("upper",)
    assert settles(twin, tmp_path)
    assert len(context.outcome.warnings) == 1
