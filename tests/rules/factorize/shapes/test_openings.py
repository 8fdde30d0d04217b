"""Families with free space in them: plates on legs, vessels with compartments, prisms with holes and wells."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from dextera_build.geometry import regions, solids
from dextera_build.geometry.solids import Solid
from rules.factorize.contact import cavity
from rules.factorize.shapes import evidence
from rules.factorize.shapes.convex_parts import convex_parts
from rules.factorize.shapes.families import compartments, legged, open_box, prism
from rules.factorize.shapes.families.hidden import completed
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic
from tests.rules.factorize.shapes.test_families import distance, shape_of

CIRCLE = 2 * np.pi * np.arange(32) / 32


def seen_of(body: Solid, **more: float) -> evidence.Evidence:
    return evidence.gather(object_views.seen(synthetic.view(body, synthetic.Eye(**more))))  # type: ignore[arg-type]


def covered(pieces: tuple[np.ndarray, ...]) -> manifold3d.Manifold:
    """The union of the hulls of the pieces."""
    hulls = [manifold3d.Manifold.hull_points(np.asarray(corners, np.float64)) for corners in pieces]
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)


def stool(height: float = 0.14) -> Solid:
    legs = [solids.box((0.016, 0.016, height), (0.08 * x, 0.06 * y, height / 2)) for x in (-1, 1) for y in (-1, 1)]
    return solids.union([solids.box((0.2, 0.16, 0.014), (0.0, 0.0, height - 0.007)), *legs])


def divided() -> tuple[Solid, np.ndarray]:
    """A vessel with a divider across and one more in one half, and the parameters of the vessel."""
    p = np.array([0.0, 0.0, 0.0, 0.24, 0.18, 0.06, 0.0, 0.001, 0.004, 0.005])
    across = solids.box((0.004, 0.178, 0.06), (-0.02, 0.0, 0.03))
    along = solids.box((0.138, 0.004, 0.06), (0.05, 0.01, 0.03))
    return solids.union([open_box.open_box_body(p), across, along]), p


def brick(floor: float) -> Solid:
    """A brick with a hole through it and, at the other end, a well down to a floor [m]."""
    body = solids.box((0.2, 0.1, 0.04), (0.0, 0.0, 0.02))
    for x, low in ((-0.05, -0.01), (0.05, floor)):
        rings = [solids.ring(0.032, 0.032, 2.0, z, 40) + np.array([x, 0.0, 0.0]) for z in (low, 0.05)]
        body = solids.difference(body, solids.loft(np.stack(rings)))
    return body


def test_convex_parts_cover_a_section_and_leave_its_hole_free():
    outer, hole = (radius * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], axis=-1) for radius in (0.05, 0.03))
    parts = convex_parts([outer, hole[::-1]], 0.0004, 96)
    exact = abs(regions.area(outer)) - abs(regions.area(hole))
    assert 4 <= len(parts) <= 24
    assert sum(regions.area(part) for part in parts) == pytest.approx(exact, rel=0.05)
    assert not any(regions.inside_convex(np.zeros((1, 2)), part).any() for part in parts)
    assert len(convex_parts([outer, hole[::-1]], 0.0004, 5)) == 5


def test_an_outline_near_a_circle_or_a_rectangle_is_one():
    rng = np.random.default_rng(0)
    circle = (0.03 + rng.normal(0.0, 0.0004, 32))[:, None] * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], axis=-1)
    made = prism.regular(circle, 0.001)
    assert np.ptp(np.linalg.norm(made - made.mean(axis=0), axis=1)) < 1e-9
    assert abs(regions.area(made)) == pytest.approx(abs(regions.area(circle)), rel=0.01)
    notched = np.array([[0, 0], [0.1, 0], [0.1, 0.04], [0.05, 0.04], [0.049, 0.0395], [0, 0.04]])
    assert len(prism.regular(notched, 0.001)) == 4
    angle = np.array([[0, 0], [0.1, 0], [0.1, 0.04], [0.05, 0.04], [0.05, 0.08], [0, 0.08]])
    assert prism.regular(angle, 0.001) is angle


def test_free_space_below_a_plate_is_seen_and_below_a_box_it_is_not():
    (found,) = legged.legged(seen_of(stool()))
    layout, model = found
    assert not layout.round
    assert model.name == "legged"
    assert legged.legged(seen_of(solids.box((0.2, 0.16, 0.14), (0.0, 0.0, 0.07)))) == []
    assert legged.legged(seen_of(stool(0.02))) == [], "too low for anything to be below it"


@pytest.mark.parametrize("layout", [legged.Layout(4, round=False), legged.Layout(3, round=True)], ids=["four", "three"])
def test_the_pieces_of_a_plate_on_legs_are_exact(layout):
    own = [0.1, 0.012, 0.003] if layout.round else [0.2, 0.16, 0.012, 0.012, 0.003]
    p = np.array([0.1, 0.2, 0.3, 0.15, 0.01, 0.1, *own])
    pieces = layout.pieces(p)
    body = solids.union(pieces)
    assert len(pieces) == layout.legs + 1
    assert object_views.mesh(body).is_closed
    assert covered(tuple(piece.vertices for piece in pieces)).volume() == pytest.approx(body.volume, rel=1e-6)
    assert body.vertices[:, 2].min() == pytest.approx(0.0)
    assert body.vertices[:, 2].max() == pytest.approx(0.15)


def test_the_dividers_of_a_vessel_are_found_in_the_depth():
    body, p = divided()
    p[2] = 0.7
    seen = seen_of(synthetic.placed(body, 0.0, 0.0, np.degrees(p[2])), pitch_deg=50.0)
    vessel = open_box.open_box(seen, 0.004)
    assert vessel is not None
    found = compartments.compartments(seen, vessel, p)
    assert found is not None
    partition, model = found
    assert [divider.axis for divider in partition.dividers] == [0, 1]
    assert partition.dividers[1].cell.bounds == ((0, -1), (-1, -1)), "the second one ends at the first"
    assert model.starts[0][compartments.OWN + 2 :] == pytest.approx([-0.02, 0.01], abs=0.004)
    assert len(partition.cells) == 3
    made = partition.solid(model.starts[0])
    assert covered(partition.pieces(model.starts[0])).volume() == pytest.approx(made.volume, rel=2e-3)


def test_an_empty_vessel_has_no_dividers():
    _, p = divided()
    seen = seen_of(open_box.open_box_body(p), pitch_deg=50.0)
    vessel = open_box.open_box(seen, 0.004)
    assert vessel is not None
    assert compartments.compartments(seen, vessel, p) is None


def test_a_prism_keeps_its_hole_and_the_floor_of_its_well():
    seen = seen_of(brick(0.015), pitch_deg=60.0)
    made = prism.prism(seen)
    assert made is not None
    stencil, model = made
    assert len(stencil.rings) == 3
    ((_, floor),) = stencil.wells
    assert floor == pytest.approx(0.015 / 0.04, abs=0.15)
    p = model.starts[0]
    body = stencil.body(p)
    assert object_views.mesh(body).is_closed
    assert body.volume == pytest.approx(brick(0.015).volume, rel=0.12)
    assert covered(stencil.pieces(p)).volume() == pytest.approx(body.volume, rel=0.02)


def tongs() -> np.ndarray:
    """Cells (H, W) bool of two crossed bars with loops at one end, symmetric about their length."""
    rows, columns = np.indices((100, 200))
    made = np.zeros(rows.shape, bool)
    for side in (-1, 1):
        off = rows - 50 - side * 0.2 * (90 - columns)
        made |= (np.abs(off) < 4) & (columns > 40) & (columns < 190)
        out = np.hypot(rows - 50 - side * 16, columns - 28)
        made |= (out < 15) & (out > 9)
    return made


def hide(whole: np.ndarray, where: tuple[slice, slice]) -> tuple[np.ndarray, np.ndarray]:
    """What is left of cells, and the hidden ones, after something hides a part of the grid."""
    hidden = np.zeros_like(whole)
    hidden[where] = True
    return whole & ~hidden, hidden


def test_a_hidden_loop_is_the_mirror_image_of_the_other_one():
    whole = tongs()
    seen, hidden = hide(whole, np.s_[54:, :70])
    made = completed(seen, hidden)
    assert (made & ~hidden == seen & ~hidden).all(), "what is in view stays"
    assert np.count_nonzero(made & whole & hidden) > 0.8 * np.count_nonzero(whole & hidden)
    assert np.count_nonzero(made & ~whole) < 0.2 * np.count_nonzero(whole & hidden)


def test_parts_on_both_sides_of_what_hides_a_body_are_joined():
    whole = tongs()
    seen, hidden = hide(whole, np.s_[:, 86:94])
    assert regions.label(seen)[1] == 2
    made = completed(seen, hidden)
    assert regions.label(made)[1] == 1
    assert np.count_nonzero(made & whole & hidden) > 0.8 * np.count_nonzero(whole & hidden)
    assert np.count_nonzero(made & ~whole) < 0.2 * np.count_nonzero(whole & hidden)


def test_without_symmetry_nothing_is_added_to_what_is_seen():
    seen, hidden = np.zeros((60, 80), bool), np.zeros((60, 80), bool)
    seen[10:20, 5:60], seen[20:50, 5:15], hidden[30:, 30:] = True, True, True
    assert (completed(seen, hidden) == seen).all()


def test_a_plain_box_is_no_prism():
    assert prism.prism(seen_of(solids.box((0.2, 0.1, 0.04), (0.0, 0.0, 0.02)))) is None


@pytest.mark.slow
def test_a_stool_has_free_space_below_it(tmp_path):
    body = synthetic.placed(stool(), 0.02, 0.01, 25)
    found = shape_of(body, tmp_path, synthetic.fine())
    assert found.hypothesis == "legged"
    assert len(found.walls) == 5
    assert not found.hollow
    assert distance(found, body) < 0.003
    solid = Solid(found.mesh.vertices.astype(float), found.mesh.faces.astype(np.int64))
    assert solid.volume == pytest.approx(body.volume, rel=0.25)


@pytest.mark.slow
def test_a_divided_vessel_keeps_its_compartments(tmp_path):
    body, _ = divided()
    found = shape_of(synthetic.placed(body, 0.0, 0.0, 40), tmp_path, synthetic.fine(pitch_deg=50.0))
    assert found.hypothesis == "compartments"
    assert found.hollow
    inside = cavity.find(found.mesh)
    assert inside.volume == pytest.approx(cavity.find(object_views.mesh(body)).volume, rel=0.1)
    assert cavity.fill(inside, found.walls) == pytest.approx(0.0, abs=0.02)


@pytest.mark.slow
def test_a_ring_that_lies_keeps_its_opening(tmp_path):
    rings = [radius * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], axis=-1) for radius in (0.05, 0.035)]
    shaft = solids.box((0.11, 0.02, 0.008), (0.1, 0.0, 0.004))
    body = solids.union([solids.extrude_rings(rings, 0.0, 0.008), shaft])
    found = shape_of(body, tmp_path, synthetic.fine(distance=0.6, pitch_deg=50.0))
    assert found.hypothesis == "prism"
    assert distance(found, body) < 0.002
    assert found.mesh.extent[2] < 0.011
    middle = np.array([0.0, 0.0, 0.004]) - found.pose.matrix[:3, 3]
    assert all((planes @ [*middle, 1.0]).max() > 0.0 for planes in map(cavity.half_spaces, found.walls))
