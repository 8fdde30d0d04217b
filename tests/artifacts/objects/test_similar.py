"""One similarity moves links, joints, masses, pieces and Gaussians alike; nothing is scaled unevenly."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.object import Asset, Joint
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.errors import ArtifactError
from dextera_build.geometry import kinematics, lie, massprops, transforms
from dextera_build.sim.model import model, touching
from tests import factories, twins

TURN = lie.rotation(np.array([0.7, -1.9, 0.4]))


def motion(scale: float) -> Similarity:
    matrix = transforms.rigid(TURN, np.array([0.3, -0.2, 0.1]))
    return Similarity(parent="object", child="object", matrix=matrix, scale=scale)


def drawer() -> Asset:
    """The laptop's parts with a slide between them."""
    made = factories.laptop_asset()
    slide = Joint(
        name="hinge", type="prismatic", parent="base", child="lid", origin=(0.0, 0.05, 0.02), axis=(0.0, 0.0, 1.0),
        lower=0.0, upper=0.2, position=0.05, lower_range=(-0.001, 0.0), upper_range=(0.2, 0.22), origin_sigma_m=0.002,
    )  # fmt: skip
    return made.model_copy(update={"body": made.body.model_copy(update={"joints": (slide,)})})


def compiled(asset: Asset):
    return model.compile_folder(twins.scene({"thing": asset}))


@pytest.mark.parametrize("made", [factories.laptop_asset(), drawer()], ids=["hinge", "slide"])
@pytest.mark.parametrize("scale", [0.1, 1.0, 3.0])
def test_moving_the_joints_and_then_the_whole_is_moving_the_whole_and_then_the_joints(made, scale):
    change = motion(scale)
    (joint,) = made.body.joints
    moved = similar.body(made.body, change)
    length = scale if joint.type == "prismatic" else 1.0
    for position in (joint.lower, joint.upper, 0.6 * joint.upper):
        before = kinematics.posed_surface(made.body, {"hinge": position})[0]
        after = kinematics.posed_surface(moved, {"hinge": length * position})[0]
        assert after == pytest.approx(transforms.apply(change.matrix, scale * before), abs=1e-6 * max(1.0, scale))
    assert (moved.joints[0].lower, moved.joints[0].upper) == pytest.approx((length * joint.lower, length * joint.upper))


def test_the_intervals_of_a_slide_are_lengths_and_those_of_a_hinge_are_not():
    (slide,) = similar.body(drawer().body, motion(2.0)).joints
    assert slide.upper_range == pytest.approx((0.4, 0.44))
    assert slide.origin_sigma_m == pytest.approx(0.004)
    (hinge,) = similar.body(factories.laptop_asset().body, motion(2.0)).joints
    assert hinge.upper == pytest.approx(2.3)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_compiled_mass_and_inertia_are_those_of_the_moved_volume(scale):
    made = factories.laptop_asset()
    asset = similar.asset(made, motion(scale))
    loaded = compiled(asset)
    for name, link in asset.body.links.items():
        before = made.body.links[name].mesh
        density = made.physics.links[name].mass_kg / massprops.of_mesh(before.vertices, before.faces).volume
        solid = massprops.of_mesh(link.mesh.vertices, link.mesh.faces)
        number = loaded.body(f"thing_{name}" if name != "base" else "thing").id
        assert loaded.body_mass[number] == pytest.approx(density * solid.volume, rel=0.01)
        found = np.sort(loaded.body_inertia[number])
        assert found == pytest.approx(massprops.principal(density * solid.inertia), rel=0.01)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_turned_and_scaled_twin_closes_without_collision(scale):
    asset = similar.asset(factories.laptop_asset(), motion(scale))
    (joint,) = asset.body.joints
    overlaps = []
    for position in np.linspace(joint.lower, joint.upper, 8):
        poses = kinematics.link_poses(asset.body, {joint.name: float(position)})
        base, lid = (
            touching.Piece(asset.collision.links[name].hulls[0].vertices).at(poses[name]) for name in ("base", "lid")
        )
        overlaps.append(base.overlap_m(lid))
    assert max(overlaps) < 5e-4
    loaded = compiled(asset)
    data = model.at_home(loaded)
    mujoco.mj_forward(loaded, data)
    assert all(contact.dist > -5e-4 for contact in data.contact)


def test_an_axis_that_is_not_turned_would_sink_the_lid():
    """The test above fails where a turn leaves the joint's axis as it was."""
    made = factories.laptop_asset()
    body = similar.body(made.body, motion(1.0))
    wrong = body.model_copy(update={"joints": (body.joints[0].model_copy(update={"axis": (-1.0, 0.0, 0.0)}),)})
    poses = kinematics.link_poses(wrong, {"hinge": 2.3})
    right = kinematics.link_poses(body, {"hinge": 2.3})
    assert np.abs(poses["lid"] - right["lid"]).max() > 0.05


def test_a_scaled_asset_stays_where_its_origin_is():
    made = factories.laptop_asset(factories.pose(0.3, 0.1, 0.0, 0.8))
    found = similar.asset(made, motion(2.0))
    where = transforms.apply(found.pose.matrix, kinematics.posed_surface(found.body)[0])
    before = transforms.apply(made.pose.matrix, 2.0 * kinematics.posed_surface(made.body)[0])
    assert where == pytest.approx(before, abs=1e-6)


def test_a_weighed_mass_stays():
    made = factories.laptop_asset()
    weighed = made.physics.model_copy(update={"weighed": True})
    found = similar.physics(weighed, similar.scaled(0.5)).links["base"]
    assert found.mass_kg == pytest.approx(weighed.links["base"].mass_kg)
    assert found.inertia == pytest.approx(np.array(weighed.links["base"].inertia) / 4)


def test_there_and_back_is_nothing():
    made, change = factories.laptop_asset(), motion(4.0)
    about_origin = change.model_copy(update={"matrix": transforms.rigid(TURN, np.zeros(3))})
    found = similar.asset(similar.asset(made, about_origin), about_origin.inverse())
    assert found.pose.matrix == pytest.approx(made.pose.matrix, abs=1e-9)
    for name, link in made.body.links.items():
        assert found.body.links[name].mesh.vertices == pytest.approx(link.mesh.vertices, abs=1e-6)
        assert found.physics.links[name].inertia == pytest.approx(made.physics.links[name].inertia, abs=1e-9)


def test_gaussians_move_as_the_mesh_does():
    made = Splats.of(factories.gaussians(20), "object")
    assert made.moved(motion(2.0)).means == pytest.approx(
        transforms.apply(motion(2.0).matrix, 2.0 * made.means.astype(np.float64)), abs=1e-5
    )


@pytest.mark.parametrize(
    ("lengths", "matches"),
    [((1.0, 1.0, 1.1), "scaled alike"), ((2.0, 2.0, 0.0), "scaled alike"), ((2.0, 2.0, -2.0), "mirrors")],
)
def test_uneven_and_mirrored_scales_are_refused(lengths, matches):
    matrix = transforms.rigid(TURN, np.zeros(3))
    matrix[:3, :3] *= np.array(lengths)
    with pytest.raises(ArtifactError, match=matches):
        Similarity.of(matrix, "object", "object")


def test_a_sheared_motion_is_refused():
    matrix = np.eye(4)
    matrix[:2, 0] = [np.cos(0.1), np.sin(0.1)]
    with pytest.raises(ArtifactError, match="not a rigid motion"):
        Similarity.of(matrix, "object", "object")


def test_an_even_scale_is_taken_apart():
    matrix = transforms.rigid(TURN, np.array([1.0, 2.0, 3.0]))
    matrix[:3, :3] *= 0.25
    found = Similarity.of(matrix, "world", "object")
    assert found.scale == pytest.approx(0.25)
    assert found.matrix[:3, :3] == pytest.approx(TURN)
