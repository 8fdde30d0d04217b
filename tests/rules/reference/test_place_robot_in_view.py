"""reference.place_robot_in_view: a robot that is seen, hides nothing, and stands in nothing."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.draw import Viewpoint
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, transforms
from dextera_build.sim.worlds.pose_trials import TriedWorld
from dextera_build.testing import RuleRunner
from tests.installed import needs
from tests.rules.reference.drawn_objects import block
from tests.rules.reference.posed import worlds

needs("mujoco")
VIEW = Viewpoint(seed=4, distance_m=0.9, pitch_deg=40.0, roll_deg=0.0, width_px=320)
NEAR = {"distance_m": [0.6, 0.9], "joints_deg": {"lean": 110.0}, "least_hand": 0.002, "least_seen": 0.005}


@cache
def world() -> World:
    """Four blocks on a bare table, seen from the front."""
    spots = {"a": (-0.15, 0.0), "b": (0.0, 0.05), "c": (0.12, -0.04), "d": (0.05, 0.2)}
    things = {
        name: block((0.06, 0.05, 0.05 + 0.02 * number)).model_copy(update={"pose": at(*spot, 0.0)})
        for number, (name, spot) in enumerate(spots.items())
    }
    table = block((1.2, 0.8, 0.03), (0.6, 0.5, 0.4)).model_copy(update={"pose": at(0.0, 0.0, -0.03)})
    eye = cameras.look_down(np.array([0.0, 0.05, 0.03]), 0.9, 0.2, np.radians(40.0), 0.0)
    return worlds.world().model_copy(
        update={
            "objects": things,
            "fixtures": {"table": table},
            "stand": None,
            "camera": Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5),
            "camera_pose": Pose(parent="reference", child="camera", matrix=eye),
        }
    )


def at(x: float, y: float, z: float) -> Pose:
    return Pose(parent="reference", child="thing", matrix=transforms.rigid(np.eye(3), np.array([x, y, z])))


def stood(tmp_path: Path, **options: object) -> World:
    found = RuleRunner(tmp_path).run(
        "reference.place_robot_in_view",
        world=world(),
        robot=worlds.robot(),
        viewpoint=VIEW,
        options={**NEAR, **options},
    )
    assert isinstance(found, World)
    return found


def test_the_robot_is_in_the_picture_and_hides_nothing(tmp_path: Path) -> None:
    made = stood(tmp_path)
    assert made.stand is not None
    assert np.array_equal(made.camera_pose.matrix, world().camera_pose.matrix)
    assert set(made.objects) == set(world().objects)
    trial = TriedWorld(world(), worlds.robot())
    hidden, seen, hand = trial.sight(made.stand)
    assert hidden.shape == (len(world().objects),)
    assert hidden.max() <= 0.02
    assert seen >= NEAR["least_seen"]
    assert hand >= NEAR["least_hand"]
    # The base is in no thing.
    place = np.array(made.stand.position)
    for thing in world().objects.values():
        points = transforms.apply(thing.pose.matrix, thing.surface.vertices.astype(np.float64))
        assert np.linalg.norm(points[:, :2] - place[:2], axis=1).min() > 0.1


def test_a_robot_before_the_things_hides_them() -> None:
    trial = TriedWorld(world(), worlds.robot())
    middle = np.mean([thing.pose.matrix[:2, 3] for thing in world().objects.values()], axis=0)
    between = 0.6 * middle + 0.4 * world().camera_pose.matrix[:2, 3]
    stand = worlds.world().stand
    assert stand is not None
    hidden, seen, _ = trial.sight(stand.model_copy(update={"position": (*between.tolist(), 0.0)}))
    assert hidden.max() > 0.2
    assert seen > 0.05


def test_where_no_place_is_good_the_rule_says_so(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="none of 5 places"):
        stood(tmp_path, tries=5, least_seen=0.9)


def test_the_stub_looks_at_nothing(tmp_path: Path) -> None:
    made = RuleRunner(tmp_path).run(
        "reference.place_robot_in_view",
        backend="stub",
        profile="stub",
        world=world(),
        robot=worlds.robot(),
        viewpoint=VIEW,
    )
    assert made.stand is not None
