"""factorize.mesh completes irregular bodies by the mirror image of what it saw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import manifold3d as m3
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Instance
from dextera_build.geometry import metrics, solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from rules.factorize.shapes import evidence
from rules.factorize.shapes.families import front
from rules.factorize.shapes.families import mirrored as family
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic


def mirrored(seen: Instance, folder: Path, *others: str, **more: float) -> Shape:
    options = {"primitives": {"hypotheses": (*others, "mirrored"), **more}}
    shape: Shape = RuleRunner(folder).run("factorize.mesh", options=options, **object_views.sights(seen))
    return shape


def solid(manifold: m3.Manifold) -> Solid:
    mesh = manifold.trim_by_plane((0.0, 0.0, 1.0), 0.0).to_mesh64()
    return Solid(np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, np.int64))


def duck() -> Solid:
    """12 cm long, mirror-symmetric in y = 0."""
    belly = m3.Manifold.sphere(1.0, 48).scale((0.06, 0.042, 0.04)).translate((0.0, 0.0, 0.036))
    head = m3.Manifold.sphere(0.026, 40).translate((0.035, 0.0, 0.085))
    beak = m3.Manifold.cube((0.03, 0.02, 0.012), True).translate((0.07, 0.0, 0.082))
    tail = m3.Manifold.sphere(1.0, 24).scale((0.02, 0.02, 0.012)).translate((-0.055, 0.0, 0.06))
    return solid(belly + head + beak + tail)


def lumps() -> Solid:
    """Two balls and a block, mirror-symmetric in y = 0."""
    balls = m3.Manifold.sphere(0.04, 48).translate((0, 0, 0.036)) + m3.Manifold.sphere(0.028, 48).translate(
        (0.03, 0, 0.085)
    )
    return solid(balls + m3.Manifold.cube((0.06, 0.04, 0.05), True).translate((-0.045, 0, 0.025)))


def distance(shape: Shape, body: Solid) -> float:
    """Chamfer-L1 [m] between a shape, in the world, and a body."""
    found = transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
    points = metrics.sample_surface(found, shape.mesh.faces, 4000, 0)
    return metrics.chamfer_and_f(points, metrics.sample_surface(body.vertices, body.faces, 4000, 1), 0.005)[0]


def volume(shape: Shape) -> float:
    return Solid(shape.mesh.vertices.astype(np.float64), shape.mesh.faces.astype(np.int64)).volume


def check_stands(shape: Shape) -> None:
    assert shape.mesh.is_closed
    assert volume(shape) > 0
    assert len(shape.mesh.faces) <= front.MOST_FACES
    assert shape.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert shape.pose.matrix[2, 3] == pytest.approx(0.0, abs=1e-6)
    assert shape.walls == ()
    assert not shape.hollow


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "yaw"), [(duck(), 20.0), *(pytest.param(lumps(), yaw, marks=pytest.mark.slow) for yaw in (-30.0, 0.0))]
)
def test_an_irregular_body_is_found_within_three_millimetres(tmp_path: Path, body: Solid, yaw: float) -> None:
    body = synthetic.placed(body, 0.02, 0.03, yaw)
    found = mirrored(synthetic.view(body, synthetic.Eye()), tmp_path)
    check_stands(found)
    assert found.mask_iou > 0.97
    assert distance(found, body) < 0.003
    assert volume(found) == pytest.approx(body.volume, rel=0.15)


@pytest.mark.slow
def test_it_wins_where_the_families_fit_badly(tmp_path: Path) -> None:
    body = synthetic.placed(duck(), 0.0, 0.0, 20)
    seen = synthetic.view(body, synthetic.Eye())
    found = mirrored(seen, tmp_path, "box", "cylinder", "oval")
    assert found.hypothesis == "mirrored"
    assert set(found.scores) == {"box", "cylinder", "oval", "mirrored"}
    best = max((name for name in found.scores if name != "mirrored"), key=lambda name: found.scores[name])
    family: Shape = RuleRunner(tmp_path).run(
        "factorize.mesh", options={"primitives": {"hypotheses": (best,)}}, **object_views.sights(seen)
    )
    assert distance(found, body) < 0.5 * distance(family, body)


@pytest.mark.slow
@pytest.mark.parametrize(
    "body",
    [
        pytest.param(solids.box((0.1, 0.07, 0.05), (0, 0, 0.025)), id="box"),
        pytest.param(synthetic.cup(0.03, 0.042, 0.1, 0.004, 0.006), id="cup", marks=pytest.mark.slow),
    ],
)
def test_a_family_that_fits_wins(tmp_path: Path, body: Solid) -> None:
    seen = synthetic.view(synthetic.placed(body, 0.0, 0.0, 20), synthetic.Eye())
    found = mirrored(seen, tmp_path, "box", "revolved_hollow", explained=1.0)
    assert found.hypothesis != "mirrored"
    assert found.scores["mirrored"] < found.scores[found.hypothesis] - 0.05


@pytest.mark.slow
def test_the_body_equals_its_mirror_image(tmp_path: Path) -> None:
    found = mirrored(synthetic.view(synthetic.placed(duck(), 0.0, 0.0, 20), synthetic.Eye()), tmp_path)
    points = metrics.sample_surface(found.mesh.vertices.astype(np.float64), found.mesh.faces, 4000, 0)
    again = metrics.sample_surface(found.mesh.vertices.astype(np.float64), found.mesh.faces, 4000, 1)
    same = metrics.chamfer_and_f(points, again, 0.005)[0]
    assert metrics.chamfer_and_f(points * [1.0, -1.0, 1.0], again, 0.005)[0] == pytest.approx(same, rel=0.2)


@pytest.mark.slow
def test_a_hole_and_a_gap_of_the_mask_and_lost_depth(tmp_path: Path) -> None:
    body = synthetic.placed(lumps(), 0.0, 0.0, 10)
    seen = synthetic.view(body, synthetic.fine())
    rows, columns = seen.view.mask.shape
    middle, part = (rows // 2, columns // 2), {}
    part["hole"], part["gap"], part["half"] = (np.ones_like(seen.view.mask) for _ in range(3))
    part["hole"][middle[0] - 8 : middle[0] + 8, middle[1] - 8 : middle[1] + 8] = False
    part["gap"][:, middle[1] - 3 : middle[1] + 3] = False
    part["half"][: middle[0]] = False
    for kept in part.values():
        check_stands(mirrored(object_views.changed(seen, mask=seen.view.mask & kept), tmp_path))
    lost = np.where(part["hole"], seen.measured.depth.depth, 0.0).astype(np.float32)
    found = mirrored(object_views.changed(seen, depth=lost), tmp_path)
    check_stands(found)
    assert distance(found, body) < 0.004


@pytest.mark.slow
def test_what_something_nearer_hides_is_filled(tmp_path: Path) -> None:
    body = synthetic.placed(lumps(), 0.0, 0.0, 0)
    post = solids.box((0.016, 0.016, 0.2), (0.0, -0.15, 0.1))
    found = mirrored(synthetic.view(body, synthetic.Eye(), hidden=(post,)), tmp_path)
    check_stands(found)
    assert found.mesh.extent[0] == pytest.approx(np.ptp(body.vertices[:, 0]), abs=0.01)


@pytest.mark.medium
def test_what_hangs_is_extended_down_to_the_table(tmp_path: Path) -> None:
    hanging = lumps().moved(transforms.rigid(np.eye(3), np.array([0.0, 0.0, 0.12])))
    seen = synthetic.view(hanging, synthetic.Eye(pitch_deg=20))
    found = mirrored(seen, tmp_path)
    check_stands(found)
    assert found.mesh.extent[2] == pytest.approx(hanging.vertices[:, 2].max(), abs=0.02)


def test_a_mask_that_is_too_thin_gives_no_candidate() -> None:
    seen = evidence.gather(object_views.seen(synthetic.view(lumps(), synthetic.Eye())))
    thin = np.zeros_like(seen.mask)
    thin[40, 20:80] = True
    assert family.mirrored(replace(seen, mask=thin)) is None
