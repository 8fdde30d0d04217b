"""Joints from two captures in different states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import kinematics, metrics, transforms
from dextera_build.testing import RuleRunner
from rules.factorize.joints import clouds, portions
from rules.factorize.joints.articulate_screw import _second as again
from rules.factorize.joints.matching import Target
from rules.factorize.joints.moved import doubt
from rules.factorize.joints.screw import Screw
from tests.benchmarks.joints import kinds, sight
from tests.benchmarks.joints.__main__ import compared, inputs_of


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def captured(kind: str, before: dict[str, float], after: dict[str, float], heading: float = 0.3, pitch: float = 40.0):
    draw = np.random.default_rng(7)
    thing = kinds.KINDS[kind](draw)
    first, second = thing.at(before), thing.at(after)
    place = sight.stand(first, draw, heading, np.radians(pitch))
    shift = transforms.rigid(np.eye(3), np.array([0.01, -0.005, 0.0]))
    return first, inputs_of(first, second, place, sight.Stand(shift @ place.pose, place.eye), 3)


@pytest.mark.slow
def test_a_lid_that_was_moved_has_its_hinge(runner):
    thing, inputs = captured("box_with_lid", {"hinge": 1.2}, {"hinge": 1.9})
    body = runner.run("factorize.articulate", **inputs)
    (joint,) = body.joints
    found = compared(thing.joints[0], body)
    assert found is not None
    assert found.type_right
    assert found.inside
    assert found.axis_deg < 2.0
    assert found.pivot_mm < 5.0
    assert joint.upper_range[0] == pytest.approx(0.7, abs=0.02)
    # What was seen is inside the limits, and the lid closes as far as its base lets it.
    assert joint.lower <= 0.0 <= joint.position <= joint.upper_range[0] <= joint.upper + 1e-6
    assert joint.lower == pytest.approx(-1.2, abs=0.25)
    assert set(body.links) == {"base", "part_1"}
    assert all(link.mesh.is_closed for link in body.links.values())


@pytest.mark.slow
def test_a_drawer_that_was_moved_slides(runner):
    thing, inputs = captured(
        "drawers", {"slide_0": 0.0, "slide_1": 0.03}, {"slide_0": 0.0, "slide_1": 0.11}, heading=0.5
    )
    body = runner.run("factorize.articulate", **inputs)
    (joint,) = body.joints
    assert joint.type == "prismatic"
    found = compared(thing.joints[1], body)
    assert found is not None
    assert found.axis_deg < 2.0
    assert joint.upper_range[0] == pytest.approx(0.08, abs=0.003)
    assert runner.outcome.line == "1 slide"


@pytest.mark.medium
def test_what_did_not_move_is_rigid(runner):
    _, inputs = captured("box_with_lid", {"hinge": 1.3}, {"hinge": 1.3})
    rigid = inputs["traits"].model_copy(update={"body_type": "rigid"})
    body = runner.run("factorize.articulate", **{**inputs, "traits": rigid})
    assert body.joints == ()
    assert runner.outcome.line == "rigid, 1 link"


@pytest.mark.slow
def test_a_part_of_a_cut_mesh_is_where_it_was_seen(runner):
    _, inputs = captured("scissors", {"pin": 0.6}, {"pin": 1.0}, pitch=60.0)
    body = runner.run("factorize.articulate", **inputs)
    vertices, _ = kinematics.posed_surface(body)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    mesh = inputs["shape"].mesh
    assert low == pytest.approx(mesh.vertices.min(axis=0), abs=1e-5)
    assert high == pytest.approx(mesh.vertices.max(axis=0), abs=1e-5)
    # Films along a cut have no volume, but twice the area of what they were cut from.
    area = sum(metrics.face_areas(link.mesh.vertices, link.mesh.faces).sum() for link in body.links.values())
    assert area < 1.1 * metrics.face_areas(mesh.vertices, mesh.faces).sum()


@pytest.mark.slow
def test_a_joint_that_does_not_explain_what_was_seen_is_doubted():
    _, inputs = captured("box_with_lid", {"hinge": 1.2}, {"hinge": 1.9})
    thing, _ = captured("box_with_lid", {"hinge": 1.2}, {"hinge": 1.9})
    first, second = clouds.of_view(Seen(inputs["view"], inputs["measured"])), again(inputs["again"])
    pose = inputs["shape"].pose.matrix
    hinge = thing.joints[0]
    axis, place = pose[:3, :3] @ hinge.axis, transforms.apply(pose, np.array(hinge.origin))
    above = (first.inner.points[:, 2] > place[2] + 0.004).astype(int)
    lid, box = portions.part(first, above, 1), portions.part(first, above, 0)
    # The box was shifted by 1 cm and -5 mm in between.
    target = Target(second.moved(transforms.rigid(np.eye(3), np.array([-0.01, 0.005, 0.0]))))
    told = Screw("revolute", place, axis, 0.7, 0.01, 0.001, 0.01, 0.0003)
    assert doubt(lid, box, target, told) == ""
    elsewhere = replace(told, origin=place + np.array([0.0, 0.0, 0.2]))
    assert doubt(lid, box, target, elsewhere) == "its axis is not where both parts are"
    assert "off the second capture" in doubt(lid, box, target, replace(told, residual=0.01))
    assert doubt(lid, box, target, replace(told, amount=0.2)) == "too little of it is seen in both captures"
    assert "a slide would look like" in doubt(lid, box, target, replace(told, amount=0.03))
