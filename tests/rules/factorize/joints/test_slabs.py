"""Hinges from the depth of one capture: from any side, nearly closed, and none in what has none."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics
from dextera_build.testing import RuleRunner
from tests import object_views
from tests.benchmarks.joints import sight
from tests.benchmarks.joints.kinds import Thing
from tests.benchmarks.joints.one_capture import PITCH, judged, moved, opened, rigid


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def articulated(runner, instance):
    """The bounding box of the view knows no hinge: the depth has to tell it."""
    shape = runner.run("factorize.mesh", backend="bounding_box", **object_views.sights(instance))
    traits = instance.traits.model_copy(update={"body_type": "articulated"})
    return runner.run("factorize.articulate", shape=shape, **{**object_views.whole(instance), "traits": traits})


def hinge(runner, kind: str, opening: float, side: float):
    thing, place, instance = opened(kind, 21, opening, side)
    body = articulated(runner, instance)
    (joint,) = body.joints
    return body, joint, judged(moved(thing.joints[0], body.pose.inverse().matrix @ place.pose), joint)


@pytest.mark.slow
@pytest.mark.parametrize(("opening", "side"), [(10, 20), (70, 45), (105, 90)])
def test_a_laptop_from_its_front_and_side_has_its_hinge_within_2_degrees_and_3_mm(runner, opening, side):
    body, joint, found = hinge(runner, "laptop", opening, side)
    assert found.good
    assert found.inside
    assert np.degrees(joint.position) == pytest.approx(opening, abs=1.5)
    assert set(body.links) == {"base", "lid"}
    assert all(link.mesh.is_closed and link.walls for link in body.links.values())
    assert body.asset_source == "rgbd"


@pytest.mark.slow
def test_a_laptop_from_behind_is_told_with_a_wider_interval(runner):
    _, joint, found = hinge(runner, "laptop", 105, 170)
    assert found.axis_deg < 2.0
    assert found.inside
    assert found.pivot_mm < 10.0
    assert joint.origin_sigma_m > 0.003


@pytest.mark.slow
@pytest.mark.parametrize("side", [20, 140])
def test_a_box_with_an_open_lid_is_hollow_and_closes(runner, side):
    body, joint, found = hinge(runner, "box_with_lid", 60, side)
    assert found.good
    assert body.hollow
    assert len(body.links["base"].walls) == 5
    assert len(body.links["lid"].walls) == 1
    closed = kinematics.link_poses(body, {joint.name: 0.0})["lid"]
    lid = body.links["lid"].mesh.vertices @ closed[:3, :3].T + closed[:3, 3]
    rim = body.links["base"].mesh.vertices[:, 2].max()
    assert lid[:, 2].min() == pytest.approx(rim, abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "mug",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("stacked books", "box", "bowl", "bracket", "cup")),
    ],
)
def test_what_has_no_hinge_gets_none(runner, name):
    thing = Thing({"base": dict(rigid(3))[name]}, ())
    place = sight.stand(thing, np.random.default_rng(3), 0.6, PITCH)
    with pytest.raises(RuleError, match="no joint was found"):
        articulated(runner, sight.look(thing, place, 3))
