"""Assets: every part is scaled by the power that physics asks for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Certainty, Collision, Joint, Physics, Placement
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, massprops
from dextera_build.statistics import Z90
from dextera_build.testing import RuleRunner
from tests import factories, object_views

S = 0.5


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def place(scale: float = S, pose: np.ndarray | None = None, scale_sigma: float | None = 0.0) -> Placement:
    where = factories.pose(0.1, 0.2, 0.3, 0.4) if pose is None else pose
    return Placement(pose=factories.placed(where), scale=scale, scale_sigma=scale_sigma, method="test")


def build(runner, made, placement, **parts):
    seen = object_views.view(made.body.links["base"].mesh, np.eye(4), category="laptop")
    inputs = {"body": made.body, "physics": made.physics, "collision": made.collision, **parts}
    return runner.run("simulate.asset", placement=placement, traits=seen.traits, **inputs)


def test_masses_go_with_the_cube_and_inertias_with_the_fifth_power(runner):
    made = factories.laptop_asset()
    found = build(runner, made, place())
    for name, before in made.physics.links.items():
        after = found.physics.links[name]
        assert after.mass_kg == pytest.approx(before.mass_kg / 8)
        assert (after.mass_low_kg, after.mass_high_kg) == pytest.approx(
            (before.mass_low_kg / 8, before.mass_high_kg / 8)
        )
        assert after.inertia == pytest.approx(np.array(before.inertia) / 32)
        assert after.centre == pytest.approx(np.array(before.centre) / 2)


def test_the_scaled_numbers_are_those_of_the_scaled_mesh(runner):
    made = factories.laptop_asset()
    found = build(runner, made, place())
    for name, link in found.body.links.items():
        solid = massprops.of_mesh(link.mesh.vertices, link.mesh.faces)
        inertial = found.physics.links[name]
        density = inertial.mass_kg / solid.volume
        assert inertial.inertia == pytest.approx(massprops.six(solid.inertia * density), rel=1e-4, abs=1e-9)


def test_geometry_walls_pieces_and_pivots_scale_but_angles_stay(runner):
    made = factories.bowl_asset()
    bowl = build(runner, made, place())
    assert bowl.body.links["base"].mesh.extent == pytest.approx(S * made.body.links["base"].mesh.extent, rel=1e-6)
    before, after = made.body.links["base"].walls[3], bowl.body.links["base"].walls[3]
    assert after.vertices == pytest.approx(S * before.vertices)
    piece = bowl.collision.links["base"].hulls[3]
    assert piece.vertices == pytest.approx(S * made.collision.links["base"].hulls[3].vertices)
    assert bowl.body.hollow
    laptop = factories.laptop_asset()
    joint = build(runner, laptop, place()).body.joints[0]
    assert joint.origin == pytest.approx(S * np.array(laptop.body.joints[0].origin))
    assert (joint.axis, joint.lower, joint.upper, joint.position) == ((-1.0, 0.0, 0.0), 0.0, 2.3, 1.9)


def test_a_scaled_hinge_still_closes_and_opens_like_the_original(runner):
    made = factories.laptop_asset()
    found = build(runner, made, place())
    for position in (0.0, 1.0, 1.9):
        before, _ = kinematics.posed_surface(made.body, {"hinge": position})
        after, _ = kinematics.posed_surface(found.body, {"hinge": position})
        assert after == pytest.approx(S * before, abs=1e-6)


def test_limits_that_are_lengths_scale(runner):
    made = factories.laptop_asset()
    slide = Joint(
        name="slide", type="prismatic", parent="base", child="lid", origin=(0.0, 0.1, 0.0), axis=(0.0, 1.0, 0.0),
        lower=-0.02, upper=0.2, position=0.1,
    )  # fmt: skip
    body = made.body.model_copy(update={"joints": (slide,)})
    joint = build(runner, made, place(), body=body).body.joints[0]
    assert (joint.lower, joint.upper, joint.position) == pytest.approx((-0.01, 0.1, 0.05))


def test_the_pose_is_the_placement_and_scale_one_changes_nothing(runner):
    made = factories.laptop_asset()
    found = build(runner, made, place(scale=1.0))
    assert found.pose.matrix == pytest.approx(factories.pose(0.1, 0.2, 0.3, 0.4))
    assert runner.encode(found.physics) == runner.encode(made.physics)
    assert found.category == "laptop"
    line, intervals = runner.outcome.line.split("; ")
    assert line == "1.300 kg, scale 1.0000, 2 collision pieces, 1 joint, rgb"
    assert intervals == "90 %: 910 to 1820 g, scale ± 0.0 %, friction ± 0.16, pose interval unknown"


def test_a_weighed_mass_is_that_of_the_scaled_body(runner):
    made = factories.laptop_asset()
    weighed = made.physics.model_copy(update={"weighed": True})
    found = build(runner, made, place(scale=0.5), physics=weighed)
    for name, before in made.physics.links.items():
        assert found.physics.links[name].mass_kg == before.mass_kg
        assert found.physics.links[name].inertia == pytest.approx(np.array(before.inertia) / 4)


def test_a_world_of_another_unit_scales_body_and_place(runner):
    made = factories.laptop_asset()
    table = factories.support().model_copy(update={"factor": 0.5, "scale": "size"})
    found = build(runner, made, place(scale=2.0), support=table)
    assert found.scale == "size"
    assert found.pose.matrix[:3, 3] == pytest.approx([0.05, 0.1, 0.15])
    assert found.body.links["base"].mesh.vertices == pytest.approx(made.body.links["base"].mesh.vertices)
    assert found.physics.links["base"].mass_kg == pytest.approx(made.physics.links["base"].mass_kg)


def test_an_asset_of_unknown_scale_says_so(runner):
    table = factories.support().model_copy(update={"scale": "unknown"})
    assert build(runner, factories.laptop_asset(), place(scale=1.0), support=table).scale == "unknown"
    assert "rgb, scale unknown; " in runner.outcome.line


@pytest.mark.parametrize("scale", [0.0, -1.0])
def test_a_scale_that_is_not_positive_is_refused(runner, scale):
    with pytest.raises(RuleError, match=rf"the scale is {scale}, but it is positive"):
        build(runner, factories.laptop_asset(), place(scale))


def test_links_must_agree_between_the_parts(runner):
    made = factories.laptop_asset()
    less = made.collision.links["base"]
    with pytest.raises(RuleError, match=r"collision has links \['base'\], but the body has \['base', 'lid'\]"):
        build(runner, made, place(), collision=Collision(links={"base": less}))
    physics = made.physics.model_copy(update={"links": {"base": made.physics.links["base"]}})
    assert isinstance(physics, Physics)
    with pytest.raises(RuleError, match=r"physics has links \['base'\], but the body has \['base', 'lid'\]"):
        build(runner, made, place(), physics=physics)


def test_the_covariance_of_the_pose_follows_the_unit_of_the_world(runner):
    placement = place(scale=1.0)
    uncertain = placement.pose.model_copy(update={"covariance": np.diag([4e-6] * 3 + [1e-4] * 3)})
    table = factories.support().model_copy(update={"factor": 0.5, "scale": "size"})
    found = build(runner, factories.laptop_asset(), placement.model_copy(update={"pose": uncertain}), support=table)
    assert np.allclose(found.pose.covariance, np.diag([1e-6] * 3 + [1e-4] * 3), rtol=1e-9, atol=0.0)


def log_width(asset) -> float:
    """Standard deviation of the log mass of the base."""
    link = asset.physics.links["base"]
    return math.log(link.mass_high_kg / link.mass_low_kg) / (2.0 * Z90)


def test_an_uncertain_scale_counts_threefold_in_the_mass(runner):
    made = factories.laptop_asset()
    known, less = (build(runner, made, place(scale_sigma=sigma)) for sigma in (0.0, 0.05))
    assert log_width(less) == pytest.approx(math.hypot(log_width(known), 0.15))
    assert (known.scale_sigma, less.scale_sigma) == (0.0, 0.05)
    unknown = build(runner, made, place(scale_sigma=None))
    assert unknown.scale_sigma is None
    assert log_width(unknown) > log_width(less)
    weighed = made.physics.model_copy(update={"weighed": True})
    assert log_width(build(runner, made, place(scale_sigma=None), physics=weighed)) == log_width(known)


def test_the_shape_s_own_size_is_in_the_interval_of_scale(runner):
    made = factories.laptop_asset()
    body = made.body.model_copy(update={"certainty": Certainty(unseen_fraction=0.5, size_sigma=0.03)})
    found = build(runner, made, place(scale_sigma=0.04), body=body)
    assert found.scale_sigma == pytest.approx(0.05)
    assert "scale ± 8.2 %" in runner.outcome.line


def test_the_line_has_the_interval_of_the_pose(runner):
    placement = place(scale=1.0)
    sigmas = np.diag([0.002, 0.001, 0.0, 0.0, 0.0, 0.02]) ** 2
    pose = placement.pose.model_copy(update={"covariance": sigmas})
    build(runner, factories.laptop_asset(), placement.model_copy(update={"pose": pose}))
    assert runner.outcome.line.endswith("position ± 3.3 mm, yaw ± 1.9 deg")
