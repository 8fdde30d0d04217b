"""Similarity registration: what collapses elsewhere must not collapse here."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import lie, raycast, registration, solids, transforms
from dextera_build.geometry.registration import ScaledPose, Search
from tests import factories

BOX = solids.box((0.12, 0.06, 0.08), (0.0, 0.0, 0.04))
K = np.array([[200.0, 0.0, 79.5], [0.0, 200.0, 59.5], [0.0, 0.0, 1.0]])
EYE = factories.look_at((0.15, -0.45, 0.35), (0.0, 0.0, 0.04))


COLUMNS, ROWS = np.meshgrid(np.arange(160), np.arange(120))
RAYS = np.stack([COLUMNS, ROWS, np.ones((120, 160))], axis=-1) @ np.linalg.inv(K).T
TRUTH = ScaledPose(1.0, factories.pose(0.01, 0.02, 0.0, 0.5))


def visible(placed: ScaledPose, from_column: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """What the camera at `EYE` sees of the placed box, in the box's frame; columns to the left are hidden."""
    surface = raycast.Surface(placed.apply(BOX.vertices), BOX.faces)
    seen = raycast.render([surface], K, EYE, 120, 160)
    hit = (seen.index >= 0) & (from_column <= COLUMNS)
    points = RAYS[hit] * seen.depth[hit][:, None]
    return placed.unapply(transforms.apply(EYE, points)), seen.normal[hit] @ placed.pose[:3, :3]


def partial_view(from_column: int = 0) -> np.ndarray:
    """Noisy points of the box at its true pose, with a few flying pixels."""
    rng = np.random.default_rng(1)
    world = TRUTH.apply(visible(TRUTH, from_column)[0])
    world += rng.normal(0.0, 0.0015, world.shape)
    world[::100] += rng.normal(0.0, 0.03, world[::100].shape)
    return world


def worst(found: ScaledPose) -> float:
    """Largest distance of a corner from its true place [m]."""
    return float(np.linalg.norm(found.apply(BOX.vertices) - TRUTH.apply(BOX.vertices), axis=1).max())


NOISE_M = 0.002
START = ScaledPose(1.15, factories.pose(0.0, 0.03, 0.0, 0.4))


def test_the_scale_of_a_half_visible_box_comes_back_within_three_percent():
    found = registration.icp(START, visible, partial_view(), Search(lie.resting(), 1.1, 0.3, NOISE_M, iterations=60))
    assert found.scale == pytest.approx(1.0, abs=0.03)
    assert worst(found) < 0.004


def test_plain_icp_with_a_free_scale_collapses_on_the_same_points():
    import open3d as o3d

    model, _ = BOX.vertices, BOX.faces
    surface = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(model), o3d.utility.Vector3iVector(BOX.faces))
    o3d.utility.random.seed(0)
    source = surface.sample_points_uniformly(4000)
    target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(partial_view()))
    start = START.pose.copy()
    start[:3, :3] *= START.scale
    method = o3d.pipelines.registration.TransformationEstimationPointToPoint(with_scaling=True)
    until = o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=200)
    result = o3d.pipelines.registration.registration_icp(source, target, 0.1, start, method, until)
    scale = float(np.cbrt(np.linalg.det(result.transformation[:3, :3])))
    # It reports a perfect fit, which is why fitness may decide nothing.
    assert result.fitness > 0.99
    assert scale < 0.9


def test_an_occluded_half_changes_neither_scale_nor_place():
    middle = 80
    start = ScaledPose(1.08, START.pose)
    points = partial_view(middle)
    assert len(points) < 0.7 * len(partial_view())
    found = registration.icp(
        start, lambda placed: visible(placed, middle), points, Search(lie.resting(), 1.0, 0.1, NOISE_M, iterations=60)
    )
    assert found.scale == pytest.approx(1.0, abs=0.03)
    assert worst(found) < 0.006


def test_a_resting_body_keeps_its_up_axis_and_its_contact():
    found = registration.icp(START, visible, partial_view(), Search(lie.resting(), 1.0, 0.1, NOISE_M))
    assert found.pose[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert found.apply(BOX.vertices)[:, 2].min() == pytest.approx(0.0, abs=1e-9)


def test_an_upright_body_keeps_its_up_axis_and_finds_the_other_five():
    """The basis is 7 x 5 in any order of components, so only its use shows a swap."""
    start = ScaledPose(1.08, factories.pose(0.03, 0.0, 0.015, 0.35))
    found = registration.icp(start, visible, partial_view(), Search(lie.UPRIGHT, 1.0, 0.1, NOISE_M, iterations=60))
    assert found.pose[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert worst(found) < 0.004


def test_all_seven_motions_are_found():
    tilted = ScaledPose(1.08, START.pose @ transforms.rigid(lie.rotation(np.array([0.08, -0.06, 0.0])), np.zeros(3)))
    found = registration.icp(tilted, visible, partial_view(), Search(lie.FREE, 1.05, 0.3, NOISE_M, iterations=60))
    assert found.scale == pytest.approx(1.0, abs=0.03)
    assert found.pose[2, 2] > np.cos(np.radians(1.5))


def test_a_model_out_of_sight_stays_where_it_is():
    behind = ScaledPose(1.0, factories.pose(0.0, -5.0))
    assert registration.icp(behind, visible, partial_view(), Search(lie.FREE, 1.0, 0.1, NOISE_M)) is behind


def test_cube_rotations_are_the_group_of_24():
    found = registration.cube_rotations()
    assert found.shape == (24, 3, 3)
    assert len({tuple(np.round(matrix).astype(int).ravel()) for matrix in found}) == 24
    assert np.linalg.det(found) == pytest.approx(np.ones(24))


def test_spread_rotations_leave_no_large_hole():
    found = registration.spread_rotations(600)
    assert found.transpose(0, 2, 1) @ found == pytest.approx(np.broadcast_to(np.eye(3), (600, 3, 3)), abs=1e-9)
    rng = np.random.default_rng(0)
    gaps = []
    for vector in rng.normal(size=(50, 3)):
        probe = lie.rotation(vector)
        traces = np.einsum("nij,ij->n", found, probe)
        gaps.append(np.degrees(np.arccos(np.clip((traces.max() - 1.0) / 2.0, -1.0, 1.0))))
    assert max(gaps) < 30.0


def test_a_similarity_undoes_itself():
    placed = ScaledPose(0.3, START.pose)
    assert placed.unapply(placed.apply(BOX.vertices)) == pytest.approx(BOX.vertices)
