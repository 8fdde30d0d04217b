"""capture.stand: a robot that is seen, hides nothing, and stands in nothing."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.draw import Arrangement, Viewpoint
from dextera_build.artifacts.world import Thing, World
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.sim.worlds.tried import TriedWorld
from dextera_build.testing import RuleRunner
from tests.rules.capture.drawn_things import blocks
from tests.rules.capture.posed import worlds

pytest.importorskip("mujoco")
VIEW = Viewpoint(seed=4, distance_m=0.9, pitch_deg=40.0, roll_deg=0.0, width_px=320)
NEAR = {"distance_m": [0.3, 0.5], "joints_deg": {"lean": 60.0}, "least_hand": 0.002, "least_seen": 0.005}


@cache
def aimed(scratch: Path) -> World:
    run = RuleRunner(scratch)
    drawn = run.run(
        "capture.draw",
        arrangement=Arrangement(seed=2, count=4, contact="apart"),
        things=Collection[Thing](items=blocks(6)),
        backend="stub",
    )
    found = run.run("capture.aim", world=drawn, viewpoint=VIEW)
    assert isinstance(found, World)
    return found


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return aimed(tmp_path_factory.mktemp("world"))


def stood(tmp_path: Path, world: World, **options: object) -> World:
    found = RuleRunner(tmp_path).run(
        "capture.stand", world=world, robot=worlds.robot(), viewpoint=VIEW, options={**NEAR, **options}
    )
    assert isinstance(found, World)
    return found


def test_the_robot_is_in_the_picture_and_hides_nothing(tmp_path: Path, world: World) -> None:
    made = stood(tmp_path, world)
    assert made.stand is not None
    assert made.stand == stood(tmp_path, world).stand
    assert made.camera_pose == world.camera_pose
    assert made.objects == world.objects
    trial = TriedWorld(world, worlds.robot())
    hidden, seen, hand = trial.sight(made.stand)
    assert hidden.shape == (len(world.objects),)
    assert hidden.max() <= 0.02
    assert seen >= NEAR["least_seen"]
    assert hand >= NEAR["least_hand"]
    # The base is in no thing.
    place = np.array(made.stand.position)
    for thing in world.objects.values():
        points = transforms.apply(thing.pose.matrix, thing.surface.vertices.astype(np.float64))
        assert np.linalg.norm(points[:, :2] - place[:2], axis=1).min() > 0.1


def test_a_robot_before_the_things_hides_them(world: World) -> None:
    trial = TriedWorld(world, worlds.robot())
    middle = np.mean([thing.pose.matrix[:2, 3] for thing in world.objects.values()], axis=0)
    between = 0.6 * middle + 0.4 * world.camera_pose.matrix[:2, 3]
    stand = worlds.world().stand
    assert stand is not None
    hidden, seen, _ = trial.sight(stand.model_copy(update={"position": (*between.tolist(), 0.0)}))
    assert hidden.max() > 0.2
    assert seen > 0.05


def test_where_no_place_is_good_the_rule_says_so(tmp_path: Path, world: World) -> None:
    with pytest.raises(RuleError, match="none of 5 places"):
        stood(tmp_path, world, tries=5, least_seen=0.9)


def test_the_stub_looks_at_nothing(tmp_path: Path, world: World) -> None:
    made = RuleRunner(tmp_path).run(
        "capture.stand", backend="stub", profile="stub", world=world, robot=worlds.robot(), viewpoint=VIEW
    )
    assert made.stand is not None
