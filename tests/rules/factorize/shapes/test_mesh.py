"""factorize.mesh recovers bodies of known size from one noisy view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Instance
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, raycast, regions, solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.rule import Context, Options
from dextera_build.testing import RuleRunner
from rules.factorize.shapes import evidence, fitted, handle, hypotheses, mesh_stub, paint, scoring
from rules.factorize.shapes.families import revolution
from rules.factorize.shapes.families.box import lying_solid
from rules.factorize.shapes.hypotheses import Finished
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic


def shape_of(seen: Instance, folder: Path, backend: str = "primitives", **options: object) -> Shape:
    shape: Shape = RuleRunner(folder).run(
        "factorize.mesh", backend=backend, options={"primitives": options}, **object_views.sights(seen)
    )
    return shape


def box(x: float, y: float, z: float) -> Solid:
    return solids.box((x, y, z), (0, 0, z / 2))


def can(radius: float, height: float) -> Solid:
    return solids.loft(np.stack([solids.ring(radius, radius, 2.0, z, 72) for z in (0.0, height)]))


def components(faces: np.ndarray) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, columns = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    size = int(faces.max()) + 1
    return int(connected_components(coo_array((np.ones(len(rows)), (rows, columns)), shape=(size, size)))[0])


def within(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    planes = ConvexHull(corners).equations
    return np.asarray((points @ planes[:, :3].T + planes[:, 3] <= 1e-6).all(axis=1))


def inside_and_in_cavity(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Random points in the cavity, with nothing above and a floor below, and in the material."""
    low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (20000, 3))
    body = raycast.Surface(shape.mesh.vertices, shape.mesh.faces)
    up = raycast.cast([body], np.c_[points, np.tile([0.0, 0, 1], (len(points), 1))])
    down = raycast.cast([body], np.c_[points, np.tile([0.0, 0, -1], (len(points), 1))])
    return points[(up.index < 0) & (down.index >= 0)], points[(up.index >= 0) & (up.normal[:, 2] > 0)]


@pytest.mark.medium
@pytest.mark.parametrize(
    ("size", "yaw", "eye", "seed"),
    [
        ((0.06, 0.158, 0.21), 25, synthetic.Eye(), 0),
        pytest.param((0.04, 0.09, 0.175), -35, synthetic.Eye(pitch_deg=28), 1, marks=pytest.mark.slow),
        pytest.param((0.15, 0.10, 0.06), 3, synthetic.Eye(distance=1.0), 2, marks=pytest.mark.slow),
    ],
)
def test_a_box_within_three_millimetres(tmp_path, size, yaw, eye, seed):
    found = shape_of(synthetic.view(synthetic.placed(box(*size), 0.03, 0.02, yaw), eye, seed), tmp_path)
    assert found.hypothesis == "box"
    assert np.sort(found.mesh.extent) == pytest.approx(np.sort(size), abs=0.003)
    assert found.mesh.extent[2] == pytest.approx(size[2], abs=0.003)
    assert found.pose.matrix[:3, 3] == pytest.approx([0.03, 0.02, 0.0], abs=0.003)
    assert found.mesh.is_closed
    assert found.mask_iou > 0.97
    assert found.unobserved == ()
    off = np.log(np.prod(found.mesh.extent.astype(np.float64)) / np.prod(size))
    assert abs(off) < 2.0 * found.volume_sigma < 0.2
    assert (np.abs(found.pose.matrix[:2, 3] - [0.03, 0.02]) < 2.0 * np.sqrt(np.diag(found.pose.covariance)[:2])).all()
    assert found.rival is not None
    assert found.scores[found.rival.hypothesis] == sorted(found.scores.values())[-2]
    assert found.rival.gap == pytest.approx(found.scores["box"] - found.scores[found.rival.hypothesis])


@pytest.mark.slow
def test_a_size_that_is_not_seen_is_uncertain(tmp_path):
    """From 14 degrees above, the depth of a tall box is guessed; from 40 degrees its top face shows it."""
    low, high = (
        shape_of(synthetic.view(box(0.09, 0.06, 0.2), synthetic.Eye(pitch_deg=pitch)), tmp_path, hypotheses=("box",))
        for pitch in (14, 40)
    )
    assert low.volume_sigma > 3.0 * high.volume_sigma
    for found in (low, high):
        off = np.log(np.prod(found.mesh.extent.astype(np.float64)) / (0.09 * 0.06 * 0.2))
        assert abs(off) < 1.645 * found.volume_sigma
    assert high.rival is None, "there is no other hypothesis"


@pytest.mark.medium
def test_a_depth_that_is_not_seen_is_said_to_be_guessed(tmp_path):
    seen = synthetic.view(box(0.09, 0.06, 0.2), synthetic.Eye(pitch_deg=14))
    runner = RuleRunner(tmp_path)
    found = runner.run("factorize.mesh", options={"primitives": {"hypotheses": ("box",)}}, **object_views.sights(seen))
    assert found.unobserved in (("x",), ("y",))
    assert "guessed" in runner.outcome.line


@pytest.mark.medium
def test_an_upright_and_a_lying_cylinder(tmp_path):
    upright = shape_of(synthetic.view(can(0.033, 0.12), synthetic.Eye()), tmp_path)
    assert upright.hypothesis == "cylinder"
    assert upright.mesh.extent == pytest.approx([0.066, 0.066, 0.12], abs=0.003)
    body = lying_solid(np.array([0, 0, 0.5, 0.035, 0.15]))
    lying = shape_of(synthetic.view(body, synthetic.Eye()), tmp_path)
    assert lying.hypothesis == "lying_cylinder"
    assert lying.mesh.extent == pytest.approx([0.15, 0.07, 0.07], abs=0.003)


@pytest.mark.parametrize(
    ("body", "size"),
    [
        (synthetic.cup(0.03, 0.042, 0.1, 0.004, 0.006), (0.084, 0.084, 0.1)),
        (synthetic.bowl(0.08, 0.035, 0.055, 0.004), (0.16, 0.16, 0.055)),
    ],
    ids=["cup", "bowl"],
)
@pytest.mark.medium
def test_a_vessel_is_hollow_and_its_walls_leave_the_cavity_free(tmp_path, body, size):
    found = shape_of(synthetic.view(body, synthetic.Eye()), tmp_path)
    assert found.hypothesis == "revolved_hollow"
    assert found.hollow
    assert found.mesh.is_closed
    assert found.mesh.extent == pytest.approx(size, abs=0.004)
    volume = Solid(found.mesh.vertices.astype(float), found.mesh.faces.astype(np.int64)).volume
    assert volume == pytest.approx(body.volume, rel=0.2)
    cavity, material = inside_and_in_cavity(found)
    walls = np.any([within(wall.vertices, cavity) for wall in found.walls], axis=0)
    assert walls.mean() < 0.04
    walls = np.any([within(wall.vertices, material) for wall in found.walls], axis=0)
    assert walls.mean() > 0.97


@pytest.mark.slow
def test_a_handle_makes_a_loop(tmp_path):
    loop = solids.difference(
        can(0.025, 0.012).moved(
            transforms.rigid(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0, 0.006, 0]))
        ),
        can(0.017, 0.03).moved(
            transforms.rigid(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0, 0.015, 0]))
        ),
    )
    ring = loop.moved(transforms.rigid(np.eye(3), np.array([0.052, 0.0, 0.05])))
    mug = synthetic.cup(0.04, 0.04, 0.095, 0.004, 0.006)
    cavity = solids.extrude(solids.ring(0.036, 0.036, 2.0, 0.0, 72)[:, :2], 0.006, 0.2)
    body = solids.difference(solids.union([mug, ring]), cavity)
    found = shape_of(synthetic.view(synthetic.placed(body, 0, 0, -15), synthetic.fine(distance=0.6)), tmp_path)
    assert found.hypothesis == "revolved_hollow"
    assert found.mesh.is_closed
    reach = float(np.linalg.norm(found.mesh.vertices[:, :2], axis=1).max())
    assert reach == pytest.approx(0.077, abs=0.004)
    # Vertices - edges + faces = 2 - 2 genus: the handle's loop is the only hole.
    vertices, faces = len(np.unique(found.mesh.faces)), len(found.mesh.faces)
    assert vertices - faces // 2 == 0


@pytest.mark.medium
def test_panels_of_an_open_laptop(tmp_path):
    body = synthetic.placed(synthetic.laptop(0.3, 0.21, 0.016, 0.2, 0.006, 110), 0, 0, 10)
    found = shape_of(synthetic.view(body, synthetic.Eye(distance=1.0)), tmp_path)
    assert found.hypothesis == "panels"
    assert components(found.mesh.faces) == 2
    assert found.mesh.is_closed
    base, lid = (wall.vertices for wall in found.walls)
    assert np.ptp(base, axis=0) == pytest.approx([0.3, 0.21, 0.016], abs=0.005)
    edge = lid[np.argsort(lid[:, 2])[-2:]].mean(axis=0) - lid[np.argsort(lid[:, 2])[:2]].mean(axis=0)
    assert np.linalg.norm(edge) == pytest.approx(0.2, abs=0.006)
    assert np.rad2deg(np.arctan2(edge[2], -edge[1])) == pytest.approx(110, abs=3)


@pytest.mark.slow
def test_panels_from_behind(tmp_path):
    body = synthetic.placed(synthetic.laptop(0.3, 0.21, 0.016, 0.2, 0.006, 110), 0, 0, 160)
    found = shape_of(synthetic.view(body, synthetic.Eye(distance=1.0)), tmp_path)
    assert found.hypothesis == "panels"
    assert found.mesh.extent == pytest.approx([0.3, 0.284, 0.204], abs=0.008)


@pytest.mark.slow
def test_a_box_that_leans(tmp_path):
    turn = np.deg2rad(25)
    lean = np.array([[1.0, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    pose = transforms.rigid(lean, np.array([0.0, 0.0, 0.08 * np.sin(turn) / 2]))
    seen = synthetic.view(synthetic.placed(box(0.12, 0.08, 0.16).moved(pose), 0, 0, 30), synthetic.Eye())
    found = shape_of(seen, tmp_path)
    assert found.hypothesis == "tilted_box"
    assert np.sort(found.mesh.extent) == pytest.approx([0.08, 0.12, 0.16], abs=0.004)
    assert np.arccos(found.pose.matrix[2, 2]) == pytest.approx(turn, abs=0.05)


@pytest.mark.slow
def test_a_can_on_a_box_stands_on_the_box(tmp_path):
    carrier = box(0.2, 0.16, 0.06)
    body = can(0.033, 0.1).moved(transforms.rigid(np.eye(3), np.array([0.0, 0.0, 0.06])))
    seen = synthetic.view(body, synthetic.Eye(), hidden=(carrier,))
    seen = object_views.changed(seen, occluder=np.zeros_like(seen.view.occluder))
    found = shape_of(seen, tmp_path)
    assert found.hypothesis == "cylinder"
    assert found.pose.matrix[2, 3] == pytest.approx(0.06, abs=0.003)
    assert found.mesh.extent == pytest.approx([0.066, 0.066, 0.1], abs=0.006)


@pytest.mark.medium
def test_a_handle_below_the_base_is_refused(monkeypatch):
    """Something else that the mask holds: the body would stand on it."""
    seen = synthetic.view(synthetic.cup(0.035, 0.04, 0.09, 0.004, 0.006), synthetic.Eye())

    def lowered(body: Finished, _: evidence.Evidence) -> Finished:
        return replace(body, solid=Solid(body.solid.vertices - [0.0, 0.0, 0.005], body.solid.faces))

    monkeypatch.setattr(fitted, "with_handle", lowered)
    monkeypatch.setattr(fitted, "judge", lambda *_: scoring.Judgement(next(scores), 0.9, 0.001, 0.0))
    scores = iter(np.linspace(0.1, 0.9, 100))  # every later body explains more
    found = evidence.gather(object_views.seen(seen))
    (vessel,) = hypotheses.propose(found, ("revolved_hollow",), 0.003)
    body, _, _ = fitted._finished(fitted.fitted_of(vessel, found, 5), found, found, 5)
    assert body.solid.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)


def test_a_bowl_that_overhangs_stands_on_the_support(tmp_path):
    seen = synthetic.view(synthetic.bowl(0.08, 0.035, 0.055, 0.004), synthetic.Eye(pitch_deg=42))
    assert evidence.gather(object_views.seen(seen)).base == 0.0


@pytest.mark.medium
def test_the_same_view_gives_the_same_bytes(tmp_path):
    seen = synthetic.view(synthetic.placed(box(0.1, 0.07, 0.05), 0, 0, 20), synthetic.Eye())
    first, second = (shape_of(seen, tmp_path, hypotheses=("box", "cylinder")) for _ in range(2))
    assert first.encode(lambda data: str(hash(data))) == second.encode(lambda data: str(hash(data)))


@pytest.mark.slow
def test_what_stands_in_front_does_not_shorten_the_box(tmp_path):
    body = synthetic.placed(box(0.16, 0.08, 0.12), 0, 0, 20)
    post = solids.box((0.03, 0.03, 0.3), (-0.02, -0.2, 0.15))
    found = shape_of(synthetic.view(body, synthetic.Eye(), hidden=(post,)), tmp_path)
    assert found.hypothesis == "box"
    assert np.sort(found.mesh.extent) == pytest.approx([0.08, 0.12, 0.16], abs=0.004)


@pytest.mark.medium
def test_the_texture_shows_the_photograph_on_the_seen_side(tmp_path):
    seen = synthetic.view(synthetic.placed(box(0.1, 0.07, 0.05), 0, 0, 20), synthetic.Eye())
    found = shape_of(seen, tmp_path, hypotheses=("box",))
    assert found.mesh.texture is not None
    assert max(found.mesh.texture.pixels.shape) <= 1024
    red, green, blue = np.median(found.mesh.texture.pixels.reshape(-1, 3), axis=0)
    assert red > 1.7 * green > 1.5 * blue
    assert 0.4 < found.unseen_fraction < 0.6


@pytest.mark.medium
def test_every_allowed_family_is_scored(tmp_path):
    runner = RuleRunner(tmp_path)
    seen = synthetic.view(can(0.033, 0.12), synthetic.fine())
    found = runner.run(
        "factorize.mesh",
        options={"primitives": {"hypotheses": ("box", "cylinder", "extruded")}},
        **object_views.sights(seen),
    )
    assert set(found.scores) == {"box", "cylinder", "extruded"}
    assert max(found.scores, key=lambda name: found.scores[name]) == found.hypothesis
    assert runner.outcome.line.startswith("cylinder, 66 x 66 x 120 mm, 1.")
    assert len(runner.outcome.previews) == 1


def test_a_view_without_depth_is_refused(tmp_path):
    seen = synthetic.view(can(0.033, 0.12), synthetic.Eye())
    blind = object_views.changed(seen, depth=np.zeros(seen.view.mask.shape, np.float32))
    for backend in ("primitives", "stub"):
        with pytest.raises(RuleError, match="the view has 0 pixels with"):
            shape_of(blind, tmp_path, backend)


def test_no_hypothesis_is_refused(tmp_path):
    seen = synthetic.view(can(0.033, 0.12), synthetic.Eye())
    with pytest.raises(RuleError, match="no hypothesis is left to try"):
        shape_of(seen, tmp_path, hypotheses=())


def test_walls_thicker_than_the_object_are_refused(tmp_path):
    with pytest.raises(RuleError, match=r"two walls of 70 mm are thicker than the object, which is 1\d\d mm large"):
        shape_of(synthetic.view(can(0.033, 0.12), synthetic.Eye()), tmp_path, wall_m=0.07)


def test_the_stub_is_a_closed_box_at_the_right_place(tmp_path):
    found = shape_of(
        synthetic.view(synthetic.placed(box(0.1, 0.1, 0.1), 0.05, 0.0, 0), synthetic.Eye()), tmp_path, "stub"
    )
    assert found.mesh.is_closed
    assert found.mesh.extent == pytest.approx([0.1, 0.1, 0.1], abs=0.02)
    assert found.pose.matrix[0, 3] == pytest.approx(0.05, abs=0.01)


def test_an_open_mesh_is_not_published(tmp_path):
    class Broken:
        @staticmethod
        def complete(ctx: Context, view: Any, measured: Any, common: Any, options: Options) -> Shape:
            whole = mesh_stub.complete(ctx, view, measured, common, options)
            part = whole.mesh.model_copy(update={"faces": whole.mesh.faces[1:], "uv": whole.mesh.uv[1:]})
            return whole.model_copy(update={"mesh": part})

    seen, rule = synthetic.view(can(0.033, 0.12), synthetic.Eye()), RuleRunner(tmp_path).find("factorize.mesh").rule
    with pytest.raises(RuleError, match="the mesh is open"):
        rule(Context(backend=Broken, scratch=tmp_path), seen.view, seen.measured, options=rule.options())


def test_the_score_prefers_the_true_body():
    seen = evidence.gather(object_views.seen(synthetic.view(box(0.1, 0.07, 0.05), synthetic.Eye())))
    true = scoring.judge(box(0.1, 0.07, 0.05), seen)
    assert true.score > 0.9
    assert true.mask_iou > 0.98
    for wrong in (box(0.12, 0.07, 0.05), box(0.1, 0.07, 0.06), synthetic.placed(box(0.1, 0.07, 0.05), 0.01, 0, 0)):
        assert scoring.judge(wrong, seen).score < true.score - 0.02


def test_a_lid_over_a_cup_violates_free_space():
    cup = synthetic.cup(0.04, 0.04, 0.095, 0.004, 0.006)
    seen = evidence.gather(object_views.seen(synthetic.view(cup, synthetic.Eye())))
    assert scoring.judge(can(0.04, 0.095), seen).free > 0.05
    assert scoring.judge(cup, seen).free < 0.01


def test_the_axis_of_a_cup_is_found_from_both_of_its_walls():
    cup = synthetic.placed(synthetic.cup(0.03, 0.042, 0.1, 0.004, 0.006), 0.04, -0.03, 0)
    seen = evidence.gather(object_views.seen(synthetic.view(cup, synthetic.Eye())))
    centre, _ = revolution.axis(seen)
    assert centre == pytest.approx([0.04, -0.03], abs=0.006)
    assert revolution.interior(seen, centre) > 0.05


def test_pinholes_are_filled_and_handles_are_not():
    mask = np.zeros((200, 200), bool)
    mask[20:180, 20:180] = True
    mask[50, 50], mask[100:130, 100:130] = False, False
    filled = regions.without_pinholes(mask)
    assert filled[50, 50]
    assert not filled[110, 110]


def test_no_handle_is_invented():
    cup = synthetic.cup(0.04, 0.04, 0.095, 0.004, 0.006)
    seen = evidence.gather(object_views.seen(synthetic.view(cup, synthetic.Eye())))
    assert handle.with_handle(hypotheses.Finished(cup, np.eye(4)), seen) is None


def test_the_facing_mirror_swaps_front_and_back():
    seen = synthetic.view(can(0.03, 0.1), synthetic.Eye())
    mirror = paint._facing_mirror(np.eye(4), object_views.seen(seen))
    assert mirror @ [0, -1.0, 0.3] == pytest.approx([0, 1.0, 0.3], abs=1e-9)
    assert mirror @ [1.0, 0, 0] == pytest.approx([1.0, 0, 0], abs=1e-9)


@pytest.mark.slow
def test_a_body_does_not_hover(tmp_path):
    """A box on low wheels that nobody sees stands on the support; without the rule, a box in the air won by 0.001."""
    wheels = [solids.box((0.02, 0.004, 0.024), (x, y, 0.012)) for x in (-0.04, 0.04) for y in (-0.02, 0.02)]
    bus = solids.union([solids.box((0.136, 0.048, 0.06), (0.0, 0.0, 0.042)), *wheels])
    found = shape_of(
        synthetic.view(synthetic.placed(bus, 0.0, 0.0, 80), synthetic.fine(distance=1.1, pitch_deg=48)), tmp_path
    )
    assert found.pose.matrix[2, 3] == pytest.approx(0.0, abs=1e-3)
    assert found.mesh.extent[2] == pytest.approx(0.072, abs=0.005)


@pytest.mark.slow
def test_a_body_high_above_the_table_stands_on_another_one(tmp_path):
    """A tilted box 80 mm up, whose neighbours' masks are not its own, is no taller thing that reaches the table."""
    turn = transforms.rigid(lie.rotation(np.array([0.5, 0.15, 0.0])), (0.0, 0.0, 0.12))
    leaning = box(0.12, 0.07, 0.04).moved(turn)
    low = float(leaning.vertices[:, 2].min())
    found = shape_of(
        synthetic.view(synthetic.placed(leaning, 0.0, 0.0, 40), synthetic.fine(distance=0.8, pitch_deg=50)), tmp_path
    )
    placed = transforms.apply(found.pose.matrix, found.mesh.vertices)
    assert low > 0.08
    assert float(placed[:, 2].min()) == pytest.approx(low, abs=0.02)
