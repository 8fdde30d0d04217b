"""Collision pieces: containers stay open, convex things stay whole."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.geometry import convex, solids
from dextera_build.testing import RuleRunner
from rules.factorize.contact import cavity
from tests import factories, object_views


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def pieces(runner, body, **options):
    return runner.run("factorize.collision", body=body, options=options).links["base"]


def rests_at(hulls: tuple[Hull, ...], radius: float, above: float) -> float:
    """Height [m] of a ball's centre two seconds after it was let go in the middle, `above` the ground."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1])
    for number, hull in enumerate(hulls):
        vertices, faces = convex.surface(hull.vertices)
        spec.add_mesh(name=f"m{number}", uservert=vertices.ravel(), userface=faces.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"m{number}")
    ball = spec.worldbody.add_body(pos=[0.003, 0.002, above])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0.0, 0.0], density=500.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    return float(data.qpos[2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "floor"),
    [
        ("mug", 0.004),
        pytest.param("bowl", 0.005, marks=pytest.mark.slow),
        pytest.param("cup", 0.004, marks=pytest.mark.slow),
    ],
)
def test_a_ball_dropped_into_a_container_ends_inside(runner, name, floor):
    vessel = object_views.mesh(getattr(object_views, name)())
    made = pieces(runner, object_views.body(vessel, hollow=True))
    assert made.method == "wedges"
    assert made.cavity_fill is not None
    assert made.cavity_fill < 0.05
    radius = 0.015
    assert rests_at(made.hulls, radius, above=0.15) == pytest.approx(floor + radius, abs=0.004)


def test_one_hull_would_keep_the_ball_out(runner):
    vessel = object_views.mesh(object_views.cup())
    lid = (Hull(vertices=vessel.vertices),)
    assert rests_at(lid, 0.015, above=0.15) > 0.09
    assert cavity.fill(cavity.find(vessel), lid) == 1.0


@pytest.mark.medium
def test_pieces_cover_the_solid_and_little_else(runner):
    import manifold3d

    vessel = object_views.mesh(object_views.mug())
    made = pieces(runner, object_views.body(vessel, hollow=True))
    solid = manifold3d.Manifold(manifold3d.Mesh(vessel.vertices.copy(), vessel.faces.astype(np.uint32)))
    parts = [manifold3d.Manifold.hull_points(hull.vertices.astype(np.float64)) for hull in made.hulls]
    covered = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)
    assert (solid - covered).volume() < 0.05 * solid.volume()
    assert covered.volume() < 1.3 * solid.volume()


def walled(*walls: Hull) -> Body:
    """A cup with these walls."""
    cup = Link(mesh=object_views.mesh(object_views.cup()), walls=walls)
    return Body(links={"base": cup}, pose=factories.placed(np.eye(4)), hollow=True)


def test_walls_are_taken_as_they_are(runner):
    walls = tuple(object_views.hull(solids.box((0.01, 0.08, 0.09), (x, 0.0, 0.045))) for x in (-0.041, 0.041))
    made = pieces(runner, walled(*walls))
    assert made.method == "walls"
    assert [hull.vertices.tolist() for hull in made.hulls] == [hull.vertices.tolist() for hull in walls]
    assert made.cavity_fill == pytest.approx(0.0, abs=1e-6)


@pytest.mark.medium
def test_walls_that_fill_the_cavity_give_way_to_wedges(runner):
    made = pieces(runner, walled(object_views.hull(solids.box((0.08, 0.08, 0.06), (0.0, 0.0, 0.03)))))
    assert made.method == "wedges"
    assert made.cavity_fill is not None
    assert made.cavity_fill < 0.05


def test_a_convex_body_is_one_hull_of_few_corners(runner):
    rings = [(0.05 * np.sin(a), 0.05 - 0.05 * np.cos(a)) for a in np.linspace(0.03, np.pi - 0.03, 40)]
    ball = object_views.mesh(object_views.turned(rings, 64))
    made = pieces(runner, object_views.body(ball), corners=100)
    assert made.method == "hull"
    assert made.cavity_fill is None
    assert 20 < len(made.hulls[0].vertices) <= 100


@pytest.mark.medium
def test_a_concave_body_without_a_cavity_goes_to_coacd_and_repeats(runner, tmp_path, monkeypatch):
    body = object_views.body(object_views.mesh(object_views.bracket()))
    first = pieces(runner, body)
    (tmp_path / "coacd.py").write_text("raise SystemExit(1)")  # a file of the user's, not the package
    monkeypatch.chdir(tmp_path)
    second = pieces(runner, body)
    assert first.method == "coacd"
    assert len(first.hulls) == 2
    assert runner.encode(first) == runner.encode(second)


@pytest.mark.slow
def test_wedges_repeat_byte_for_byte(runner):
    body = object_views.body(object_views.mesh(object_views.cup()), hollow=True)
    assert runner.encode(pieces(runner, body)) == runner.encode(pieces(runner, body))


@pytest.mark.slow
def test_the_line_says_what_was_reached_and_what_was_not(runner):
    body = object_views.body(object_views.mesh(object_views.bowl()), hollow=True)
    pieces(runner, body, coacd={"pieces": 12, "attempts": 1})
    assert runner.outcome.line.startswith("base: 12 by wedges, cavity filled ")
    assert "%, 5% was requested, volume +" in runner.outcome.line
    assert len(runner.outcome.previews) == 1


def test_the_stub_gives_one_hull_without_a_picture(runner):
    body = object_views.body(object_views.mesh(object_views.mug()), hollow=True)
    made = runner.run("factorize.collision", body=body, backend="stub").links["base"]
    assert made.method == "hull"
    assert len(made.hulls) == 1
    extent = np.ptp(made.hulls[0].vertices, axis=0)
    assert extent == pytest.approx(body.links["base"].mesh.extent, abs=1e-6)
    assert runner.outcome.previews == []


def test_the_cavity_of_a_cup_has_its_true_volume():
    found = cavity.find(object_views.mesh(object_views.cup()))
    assert found.volume == pytest.approx(np.pi * 0.036**2 * 0.086, rel=0.04)


def test_neither_a_box_nor_an_arch_has_a_cavity():
    box = object_views.mesh(solids.box((0.1, 0.1, 0.1), (0.0, 0.0, 0.05)))
    arch = solids.difference(solids.box((0.2, 0.1, 0.1), (0, 0, 0.05)), solids.box((0.1, 0.2, 0.05), (0, 0, 0.02)))
    assert len(cavity.find(box).points) == 0
    assert len(cavity.find(object_views.mesh(arch)).points) == 0
    assert cavity.fill(cavity.find(box), (Hull(vertices=box.vertices),)) is None


@pytest.mark.slow
def test_what_takes_coacd_too_long_is_cut_into_wedges(runner):
    import manifold3d

    balls = [manifold3d.Manifold.sphere(0.02, 48).translate((0.05 * i, 0.03 * (i % 2), 0.02)) for i in range(24)]
    mesh = manifold3d.Manifold.batch_boolean(balls, manifold3d.OpType.Add).to_mesh64()
    knobs = solids.Solid(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64))
    # So many faces take CoACD three times the limit on a fast machine.
    limits = {"seconds": 1, "threshold": 0.01, "faces": 12000}
    made = pieces(runner, object_views.body(object_views.mesh(knobs)), coacd=limits)
    assert made.method == "wedges"
    assert runner.outcome.warnings == ["CoACD took more than 1 s; the link was cut into wedges"]
    assert made.lacking < 0.12


def test_the_volume_error_counts_overlaps_once_and_gaps(runner):
    box = object_views.mesh(solids.box((0.1, 0.1, 0.1), (0.0, 0.0, 0.05)))
    halves = [solids.box((0.07, 0.1, 0.1), (x, 0.0, 0.05)) for x in (-0.015, 0.015)]
    link = Link(mesh=box, walls=tuple(object_views.hull(half) for half in halves))
    body = Body(links={"base": link}, pose=factories.placed(np.eye(4)))
    made = pieces(runner, body)
    assert (made.excess, made.lacking) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.0, abs=1e-4))
    assert runner.outcome.line == "base: 2 by walls, volume +0.0% -0.0%"
    one = body.model_copy(update={"links": {"base": link.model_copy(update={"walls": link.walls[:1]})}})
    assert pieces(runner, one).lacking == pytest.approx(0.3, abs=1e-3)
    bracket = pieces(runner, object_views.body(object_views.mesh(object_views.bracket())), coacd={"convexity": 0.1})
    assert bracket.method == "hull"
    assert bracket.excess > 0.2
