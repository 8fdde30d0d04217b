"""reference.background_views: a drawn room without its things, from the capture's camera and from others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.scenes.draw import Arrangement, Viewpoint
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.evaluate.posed import PosedViews
from tests.rules.reference.drawn_objects import blocks


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    runner = RuleRunner(tmp_path_factory.mktemp("world"))
    drawn = runner.run(
        "reference.draw",
        arrangement=Arrangement(seed=1, count=4, contact="apart"),
        things=Collection[Thing](items=blocks(6)),
        backend="stub",
    )
    eye = Viewpoint(seed=1, distance_m=0.8, pitch_deg=45.0, roll_deg=3.0, width_px=160)
    aimed: World = runner.run("reference.look_at", world=drawn, viewpoint=eye)
    return aimed


@pytest.fixture(scope="module", params=["stub", "mujoco"])
def views(request: pytest.FixtureRequest, world: World, tmp_path_factory: pytest.TempPathFactory) -> PosedViews:
    path = tmp_path_factory.mktemp("emptied")
    made: Folder = RuleRunner(path).run(
        "reference.background_views", world=world, backend=request.param, options={"views": 3}
    )
    return PosedViews(Context(scratch=path), made)


@pytest.mark.slow
def test_the_first_view_is_the_captures_and_the_things_are_gone(
    world: World, views: PosedViews, tmp_path: Path
) -> None:
    assert views.own == 0
    np.testing.assert_allclose(views.poses[0], world.camera_pose.matrix, atol=1e-12)
    truth = RuleRunner(tmp_path).run("reference.truth", world=world, backend="stub", options={"hidden": "leave_out"})
    things = truth.labels.labels > 0
    assert things.mean() > 0.02
    assert (things == views.objects()).mean() > 0.99
    gap = views.view(0).depth - truth.depth.depth
    assert np.median(gap[things]) > 0.01, "the table behind them is farther"
    assert np.abs(gap[~things]).mean() < 2e-3


@pytest.mark.medium
def test_the_others_look_at_the_same_place_from_elsewhere(world: World, views: PosedViews) -> None:
    own = world.camera_pose.matrix
    target = own[:3, 3] + own[:3, 2] * own[2, 3] / -own[2, 2]
    others = [views.poses[frame] for frame in sorted(views.poses) if frame != views.own]
    assert len(others) == 3
    for pose in others:
        away = target - pose[:3, 3]
        np.testing.assert_allclose(away / np.linalg.norm(away), pose[:3, 2], atol=1e-6)
        turn = pose[:2, 2] @ own[:2, 2] / np.linalg.norm(pose[:2, 2]) / np.linalg.norm(own[:2, 2])
        assert np.degrees(np.arccos(turn)) <= 30.0 + 1e-6
        assert np.linalg.norm(pose[:3, 3] - own[:3, 3]) > 0.01


def test_capture_json_is_small(views: PosedViews) -> None:
    facts = json.loads(views._files["capture.json"])
    assert facts == {"frame": 0, "objects": "objects.png"}
