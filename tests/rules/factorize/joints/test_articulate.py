"""Hinges: where they are, how they close, what happens without a crease."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Body
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, massprops, metrics, solids
from dextera_build.testing import RuleRunner
from tests import object_views

ANGLES = (pytest.param(0.6, marks=pytest.mark.slow), 1.885, pytest.param(2.5, marks=pytest.mark.slow))


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def hinged(runner, opening: float, overlap: float = 0.0, *, walls: bool = False, backend: str = "crease", **options):
    whole, slabs = object_views.laptop(opening, overlap)
    mesh = object_views.mesh(whole)
    seen = object_views.view(mesh, np.eye(4), category="laptop", body_type="articulated", material="electronics")
    shape = object_views.shape(mesh, tuple(object_views.hull(slab) for slab in slabs) if walls else ())
    body = runner.run("factorize.articulate", shape=shape, **object_views.whole(seen), backend=backend, options=options)
    assert isinstance(body, Body)
    return mesh, body


@pytest.fixture(scope="module")
def laptop(tmp_path_factory):
    """Mesh and body by opening [rad] and overlap [m], made once."""
    runner = RuleRunner(tmp_path_factory.mktemp("laptop"))
    return cache(lambda opening, overlap: hinged(runner, opening, overlap))


def test_a_rigid_object_is_one_link(runner):
    mesh = object_views.mesh(object_views.mug())
    seen = object_views.view(mesh, np.eye(4))
    body = runner.run("factorize.articulate", shape=object_views.shape(mesh), **object_views.whole(seen))
    assert list(body.links) == ["base"]
    assert body.joints == ()
    assert runner.outcome.line == "rigid, 1 link"


@pytest.mark.medium
@pytest.mark.parametrize("opening", ANGLES)
@pytest.mark.parametrize("overlap", [0.0, pytest.param(0.004, marks=pytest.mark.slow)])
def test_the_hinge_lies_in_the_crease_and_stands_at_the_true_angle(laptop, opening, overlap):
    _, body = laptop(opening, overlap)
    (joint,) = body.joints
    assert joint.position == pytest.approx(opening, abs=1e-3)
    assert np.abs(joint.axis) == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
    assert joint.origin[1:] == pytest.approx((0.11, 0.018), abs=6e-4)
    assert joint.lower == 0.0
    assert joint.upper >= joint.position + 0.1
    assert (joint.parent, joint.child) == ("base", "lid")


@pytest.mark.parametrize("opening", ANGLES)
def test_the_lid_closes_onto_the_base_without_sinking_in(laptop, opening):
    _, body = laptop(opening, 0.0)
    closed = body.links["lid"].mesh.vertices
    assert closed[:, 2].min() == pytest.approx(0.018 + 0.0002, abs=2e-5)
    assert closed[:, 2].max() == pytest.approx(0.026 + 0.0002, abs=2e-5)
    solid = [_solid(body, angle) for angle in np.linspace(0.0, body.joints[0].upper, 9)]
    assert max(float((base ^ lid).volume()) for base, lid in solid) < 2e-7


def _solid(body: Body, position: float):
    import manifold3d

    poses = kinematics.link_poses(body, {"hinge": position})
    made = []
    for name in ("base", "lid"):
        mesh = body.links[name].mesh
        solid = manifold3d.Manifold(manifold3d.Mesh(mesh.vertices.copy(), mesh.faces.astype(np.uint32)))
        made.append(solid.transform(poses[name][:3]))
    return made


@pytest.mark.slow
@pytest.mark.parametrize("overlap", [0.0, 0.004])
def test_at_the_observed_angle_the_links_are_where_they_were_seen(laptop, overlap):
    mesh, body = laptop(1.885, overlap)
    vertices, faces = kinematics.posed_surface(body)
    chamfer, within = metrics.chamfer_and_f(
        metrics.sample_surface(vertices, faces, 40000, 0),
        metrics.sample_surface(mesh.vertices, mesh.faces, 40000, 1),
        0.004,
    )
    assert within > 0.99
    assert chamfer < 0.003
    volume = sum(massprops.of_mesh(link.mesh.vertices, link.mesh.faces).volume for link in body.links.values())
    assert volume == pytest.approx(massprops.of_mesh(mesh.vertices, mesh.faces).volume, rel=1e-4)
    assert all(link.mesh.is_closed for link in body.links.values())


@pytest.mark.slow
def test_walls_follow_their_link(runner):
    _, body = hinged(runner, 1.885, walls=True)
    for link in body.links.values():
        (wall,) = link.walls
        assert wall.vertices.min(axis=0) == pytest.approx(link.mesh.vertices.min(axis=0), abs=1e-5)
        assert wall.vertices.max(axis=0) == pytest.approx(link.mesh.vertices.max(axis=0), abs=1e-5)


@pytest.mark.slow
def test_texture_coordinates_survive_the_cut(runner):
    whole, _ = object_views.laptop(1.885, 0.004)
    plain = object_views.mesh(whole)
    corners = plain.vertices[plain.faces]
    uv = np.ascontiguousarray(corners[..., :2] + 0.5, np.float32)
    textured = Mesh(
        vertices=plain.vertices, faces=plain.faces, uv=uv, texture=Image(pixels=np.zeros((4, 4, 3), np.uint8))
    )
    seen = object_views.view(textured, np.eye(4), body_type="articulated")
    body = runner.run("factorize.articulate", shape=object_views.shape(textured), **object_views.whole(seen))
    base = body.links["base"].mesh
    corners = base.vertices[base.faces]
    kept = np.abs(base.uv - corners[..., :2] - 0.5).max(axis=(1, 2)) < 1e-4
    areas = metrics.face_areas(base.vertices, base.faces)
    # Only the face of the cut has no texture of its own.
    assert areas[kept].sum() > 0.95 * areas.sum()
    assert areas[~kept].sum() > 0.0


@pytest.mark.slow
def test_the_line_and_the_picture_tell_the_hinge(runner):
    hinged(runner, np.radians(108.0))
    assert runner.outcome.line == "1 hinge, 0-131 deg, at 108 deg"
    assert len(runner.outcome.previews) == 2
    assert abs(runner.outcome.metrics["seen_minus_mesh"][0]) < 0.5


@pytest.mark.medium
def test_a_box_has_no_crease(runner):
    mesh = object_views.mesh(solids.box((0.3, 0.2, 0.1), (0.0, 0.0, 0.05)))
    seen = object_views.view(mesh, np.eye(4), body_type="articulated")
    ball = object_views.mesh(
        object_views.turned([(0.05 * np.sin(a), 0.05 - 0.05 * np.cos(a)) for a in np.linspace(0.1, 3.0, 30)])
    )
    with pytest.raises(RuleError, match="no joint was found") as caught:
        runner.run("factorize.articulate", shape=object_views.shape(ball), **object_views.whole(seen))
    assert "`body_type: rigid`" in caught.value.hint
    body = runner.run(
        "factorize.articulate",
        shape=object_views.shape(ball),
        **object_views.whole(seen),
        options={"without_crease": "rigid"},
    )
    assert list(body.links) == ["base"]
    assert runner.outcome.line == "kept rigid: no joint found"


@pytest.mark.medium
def test_a_declared_hinge_is_taken_as_it_is(runner):
    declared = {"origin_m": (0.0, 0.11, 0.0182), "axis": (-1.0, 0.0, 0.0), "angle_rad": 1.885}
    _, body = hinged(runner, 1.885, hinge=declared)
    assert body.joints[0].origin == pytest.approx((0.0, 0.11, 0.0182))
    assert body.joints[0].position == 1.885


def test_a_hinge_at_the_wrong_height_sinks_in_and_is_refused(runner):
    declared = {"origin_m": (0.0, 0.11, 0.009), "axis": (-1.0, 0.0, 0.0), "angle_rad": 1.885}
    with pytest.raises(RuleError, match=r"the lid sinks \d+\.\d mm into the base while it closes"):
        hinged(runner, 1.885, hinge=declared)


def test_the_stub_gives_two_closed_links_and_a_joint(runner):
    _, body = hinged(runner, 1.885, backend="stub")
    assert all(link.mesh.is_closed and link.walls for link in body.links.values())
    assert massprops.of_mesh(body.links["lid"].mesh.vertices, body.links["lid"].mesh.faces).volume > 0.0
    assert body.joints[0].type == "revolute"
