"""factorize.mesh on vessels with corners, vessels that lie, and bodies in any pose, from one noisy view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Shape
from dextera_build.geometry import lie, metrics, solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from rules.factorize.contact import cavity
from rules.factorize.shapes import evidence
from rules.factorize.shapes.families import open_box, superquadric
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic


def shape_of(body: Solid, folder: Path, eye: synthetic.Eye | None = None, **options: object) -> Shape:
    seen = synthetic.view(body, eye or synthetic.Eye())
    shape: Shape = RuleRunner(folder).run(
        "factorize.mesh", options={"primitives": options}, **object_views.sights(seen)
    )
    assert shape.mesh.is_closed
    return shape


def in_world(shape: Shape) -> np.ndarray:
    """Corners of the shape where it was seen [m]."""
    assert shape.pose is not None
    return np.asarray(transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64)))


def distance(shape: Shape, body: Solid) -> float:
    """Chamfer-L1 [m] between a shape, in the world, and a body."""
    points = metrics.sample_surface(in_world(shape), shape.mesh.faces, 4000, 0)
    return metrics.chamfer_and_f(points, metrics.sample_surface(body.vertices, body.faces, 4000, 1), 0.005)[0]


def basket(size: tuple[float, float, float], slope: float, wall: float, floor: float) -> Solid:
    """A rectangular vessel with walls that lean outwards."""
    x, y, height = size
    rings = []
    for z, inset in ((0.0, 0.0), (height, 0.0), (height, wall), (floor, wall)):
        a, b = (edge / 2 - slope * (height - z) - inset for edge in (x, y))
        rings.append(np.array([[a, b, z], [-a, b, z], [-a, -b, z], [a, -b, z]]))
    return solids.loft(np.stack(rings))


def on_table(body: Solid, turn: np.ndarray) -> Solid:
    """The body turned, with its lowest point on the table."""
    made = body.moved(transforms.rigid(turn, np.zeros(3)))
    return Solid(made.vertices - [0.0, 0.0, made.vertices[:, 2].min()], made.faces)


@pytest.mark.parametrize(
    ("size", "slope", "pitch"), [((0.24, 0.16, 0.12), 0.15, 40), ((0.3, 0.2, 0.05), 0.0, 35)], ids=["basket", "tray"]
)
@pytest.mark.slow
def test_a_rectangular_vessel_is_hollow_and_its_walls_leave_the_cavity_free(tmp_path, size, slope, pitch):
    body = synthetic.placed(basket(size, slope, 0.005, 0.006), 0.02, 0.01, 25)
    found = shape_of(body, tmp_path, synthetic.fine(distance=0.9, pitch_deg=pitch))
    assert found.hypothesis == "open_box"
    assert found.hollow
    assert np.sort(found.mesh.extent) == pytest.approx(np.sort(size), abs=0.006)
    solid = Solid(found.mesh.vertices.astype(float), found.mesh.faces.astype(np.int64))
    assert solid.volume == pytest.approx(body.volume, rel=0.35)
    inside = cavity.find(found.mesh)
    assert inside.volume == pytest.approx(cavity.find(object_views.mesh(body)).volume, rel=0.1)
    assert cavity.fill(inside, found.walls) == pytest.approx(0.0, abs=0.01)


def test_a_closed_box_shows_no_inside():
    seen = synthetic.view(solids.box((0.2, 0.15, 0.1), (0.0, 0.0, 0.05)), synthetic.Eye())
    assert open_box.inside(evidence.gather(object_views.seen(seen))).mean() < open_box.LEAST_PART
    seen = synthetic.view(basket((0.2, 0.15, 0.1), 0.0, 0.004, 0.004), synthetic.Eye())
    assert open_box.inside(evidence.gather(object_views.seen(seen))).mean() > 4 * open_box.LEAST_PART


def test_the_walls_of_a_rectangular_vessel_are_exact():
    p = np.array([0.0, 0.0, 0.0, 0.2, 0.14, 0.1, 0.2, 0.02, 0.004, 0.006])
    pieces = [object_views.hull(Solid(corners, np.zeros((0, 3), int))) for corners in open_box.walls(p)]
    body = open_box.open_box_body(p)
    import manifold3d

    parts = [manifold3d.Manifold.hull_points(hull.vertices.astype(np.float64)) for hull in pieces]
    covered = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)
    assert covered.volume() == pytest.approx(body.volume, rel=1e-3)


@pytest.mark.slow
def test_a_mug_that_lies_is_hollow_about_its_own_axis(tmp_path):
    lying = on_table(synthetic.cup(0.036, 0.04, 0.1, 0.004, 0.006), lie.rotation(np.array([np.deg2rad(92), 0.0, 0.0])))
    body = synthetic.placed(lying, 0.0, 0.0, 25)
    found = shape_of(body, tmp_path, synthetic.Eye(distance=0.6))
    assert found.hypothesis == "tilted_revolved_hollow"
    assert found.hollow
    assert distance(found, body) < 0.004
    assert found.pose is not None
    assert abs(found.pose.matrix[2, 2]) < 0.2, "its own axis lies"
    filled = cavity.fill(cavity.find(found.mesh), found.walls)
    assert filled is not None
    assert filled < 0.05


@pytest.mark.slow
def test_an_ellipsoid_that_leans(tmp_path):
    p = np.zeros(13)
    p[7:12] = [0.03, 0.04, 0.065, 1.0, 1.0]
    body = on_table(superquadric.body(p, 48, 24), lie.rotation(np.array([0.5, 0.3, 0.2])))
    found = shape_of(body, tmp_path)
    assert found.hypothesis == "superquadric"
    assert distance(found, body) < 0.006
    assert float(in_world(found)[:, 2].min()) == pytest.approx(0.0, abs=0.008)
    assert np.sort(found.mesh.extent) == pytest.approx([0.06, 0.08, 0.13], abs=0.014)


def test_a_superquadric_between_a_box_and_a_cylinder_has_its_volume():
    def volume(along: float, around: float) -> float:
        return superquadric.body(np.array([*[0.0] * 7, 0.5, 0.5, 0.5, along, around, 0.0]), 96, 48).volume

    assert volume(1.0, 1.0) == pytest.approx(np.pi / 6, rel=0.01)
    assert volume(0.05, 1.0) == pytest.approx(np.pi / 4, rel=0.02)
    assert volume(0.05, 0.05) == pytest.approx(1.0, rel=0.02)


@pytest.mark.medium
def test_a_bottle_that_lies(tmp_path):
    radii = [(0.03, 0.0), (0.033, 0.01), (0.033, 0.11), (0.013, 0.15), (0.013, 0.18)]
    standing = solids.loft(np.stack([solids.ring(r, r, 2.0, z, 72) for r, z in radii]))
    body = synthetic.placed(on_table(standing, lie.rotation(np.array([0.0, np.pi / 2 + 0.03, 0.0]))), 0.0, 0.0, 35)
    found = shape_of(body, tmp_path)
    assert found.hypothesis == "lying"
    assert distance(found, body) < 0.003
