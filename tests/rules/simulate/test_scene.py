"""simulate.scene: what it hands on and what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.rule import Context
from rules.simulate.scene.metric import metric
from rules.simulate.scene.scene import scene
from tests import factories


def test_the_scene_names_every_object_and_says_what_it_weighs(tmp_path: Path) -> None:
    assets = {"Blue Box": factories.box_asset(mass=0.4), "laptop": factories.laptop_asset(mass=1.3)}
    table, lens = factories.support(), factories.camera()
    context = Context(scratch=tmp_path)
    result = scene(context, Collection[Asset](items=assets), factories.background(), table, lens)
    assert result.bodies == ("blue_box", "laptop")
    assert result.camera == lens
    assert context.outcome.line == "2 bodies, 1 joint, 1.70 kg"
    assert {"scene.xml", "assets/blue_box.obj", "assets/laptop_lid.obj"} <= set(result.model.files)


def test_a_scene_of_unknown_scale_says_so(tmp_path: Path) -> None:
    table = factories.support().model_copy(update={"scale": "unknown"})
    context = Context(scratch=tmp_path)
    result = scene(context, Collection[Asset](items={}), factories.background(), table, factories.camera())
    assert result.scale == "unknown"
    assert context.outcome.line == "0 bodies, 0 joints, 0.00 kg, scale unknown"


def test_the_background_gets_the_unit_of_its_support() -> None:
    raw = factories.background()
    half = metric(raw, 0.5)
    assert np.array_equal(half.mesh.vertices, raw.mesh.vertices * np.float32(0.5))
    assert np.array_equal(half.depth.depth, raw.depth.depth * np.float32(0.5))
    assert half.boxes[0].half_size == tuple(0.5 * length for length in raw.boxes[0].half_size)
    assert half.boxes[0].centre == tuple(0.5 * length for length in raw.boxes[0].centre)
    assert metric(raw, 1.0) is raw


def test_an_empty_collection_is_a_bare_scene(tmp_path: Path) -> None:
    table, lens = factories.support(), factories.camera()
    context = Context(scratch=tmp_path)
    result = scene(context, Collection[Asset](items={}), factories.background(), table, lens)
    assert result.bodies == ()
    assert context.outcome.line == "0 bodies, 0 joints, 0.00 kg"
