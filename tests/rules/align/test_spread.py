"""Covariance of placements: it holds the true errors, and grows with whatever makes a photograph worse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.objects.object import Placement
from dextera_build.geometry import lie, solids, transforms
from dextera_build.geometry.registration import ScaledPose
from dextera_build.testing import RuleRunner
from rules.align.object import polish, spread
from rules.align.object.model_view import ModelView
from tests import factories, object_views, tabletops

TRUTH = factories.pose(0.02, 0.03, 0.0, 0.6)
BRACKET = object_views.mesh(object_views.bracket())
BOX = object_views.mesh(solids.box((0.12, 0.06, 0.08), (0.0, 0.0, 0.04)))
VIEWS = 12
OFF = np.array([0.003, -0.002, 0.0015, 0.03, -0.02, 0.04, 0.03])
"""Twist from a wrong placement to the true one: all components differ, so that no two can be confused."""


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def place(runner, seen, guess=TRUTH, mesh=BRACKET, **icp) -> Placement:
    body = object_views.body(mesh, guess)
    return runner.run("align.object", body=body, **object_views.sights(seen), options={"icp": icp})


def deviations(placed: Placement) -> np.ndarray:
    """Standard deviations of x, y [m], yaw [rad] and log scale."""
    assert placed.pose.covariance is not None
    assert placed.scale_sigma is not None
    return np.array([*np.sqrt(np.diag(placed.pose.covariance))[[0, 1, 5]], placed.scale_sigma])


def errors(placed: Placement) -> np.ndarray:
    """The true errors of the same."""
    off = placed.pose.matrix @ transforms.invert(TRUTH)
    yaw = np.arctan2(off[1, 0], off[0, 0])
    return np.array([*(placed.pose.matrix - TRUTH)[:2, 3], yaw, np.log(placed.scale)])


@pytest.mark.slow
def test_the_stated_deviations_are_those_of_the_true_errors(runner):
    """Noise of 3 mm, more than the sensor's model says; `guess_scale_sigma` leaves the scale to the data."""
    off = factories.pose(0.024, 0.027, 0.0, 0.63)
    ratios = []
    for seed in range(VIEWS):
        seen = object_views.view(BRACKET, TRUTH, noise_m=0.003, seed=seed)
        placed = place(runner, seen, off, gain=0.0, guess_scale_sigma=0.1)
        assert placed.method.startswith("guess refined")
        ratios.append(errors(placed) / deviations(placed))
    spread = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert (spread < 1.6).all(), f"the errors are larger than stated: {spread}"
    assert (spread > 0.1).all(), f"the stated deviations mean nothing: {spread}"


@pytest.fixture(scope="module")
def model():
    return ModelView(
        BRACKET.vertices.astype(np.float64), BRACKET.faces, object_views.seen(object_views.view(BRACKET, TRUTH))
    )


def moved_by(step: np.ndarray) -> ScaledPose:
    """The true placement without a twist: translation, rotation vector and log scale about its origin."""
    turn = Rotation.from_rotvec(-step[3:6]).as_matrix() @ TRUTH[:3, :3]
    return ScaledPose(float(np.exp(-step[6])), transforms.rigid(turn, TRUTH[:3, 3] - step[:3]))


def left(placed: ScaledPose) -> np.ndarray:
    """The twist (7,) from a placement to the true one."""
    turn = Rotation.from_matrix(TRUTH[:3, :3] @ placed.pose[:3, :3].T).as_rotvec()
    return np.concatenate([TRUTH[:3, 3] - placed.pose[:3, 3], turn, [-np.log(placed.scale)]])


@pytest.mark.parametrize("component", range(7))
def test_a_step_undoes_a_displacement_in_its_own_component(model, component):
    """Translation, rotation vector, log scale: another order of the rows, of a basis or of the retraction fails."""
    off = OFF * (np.arange(7) == component)
    step, _ = spread.step(model, moved_by(off), 10.0, lie.FREE)
    unit = np.abs(OFF)
    assert step[component] / OFF[component] == pytest.approx(1.0, abs=0.5)
    assert (np.abs(step - off) / unit < 0.5).all()


def test_polishing_finds_the_way_back_from_all_seven_errors(model):
    found = polish.polished(model, moved_by(OFF), 10.0, lie.FREE)
    assert (np.abs(left(found)) < 0.25 * np.abs(OFF)).all()


@pytest.mark.parametrize(
    ("basis", "kept"), [(lie.UPRIGHT, (3, 4)), (lie.resting(0.0), (2, 3, 4))], ids=["upright", "resting"]
)
def test_an_upright_body_is_certain_of_its_tilt_and_of_nothing_else(model, basis, kept):
    stated = np.sqrt(np.diag(spread.covariance(model, moved_by(np.zeros(7)), 0.2, 0.1, basis)))
    assert np.flatnonzero(stated < 1e-9).tolist() == list(kept)
    level, turn, size = stated[:2], stated[5], stated[6]
    assert (level < 0.002).all()
    assert 1e-4 < turn < 0.02
    assert 1e-4 < size < 0.02


@pytest.mark.medium
def test_noise_fewer_points_and_a_hidden_half_widen_all(runner):
    good = deviations(place(runner, object_views.view(BRACKET, TRUTH, noise_m=0.001)))
    noisy = deviations(place(runner, object_views.view(BRACKET, TRUTH, noise_m=0.008)))
    assert (noisy > 1.2 * good).all()
    seen = object_views.view(BRACKET, TRUTH, noise_m=0.001)
    lost = np.random.default_rng(0).uniform(size=seen.view.mask.shape) < 0.8
    thin = object_views.changed(seen, depth=np.where(lost, 0.0, seen.measured.depth.depth).astype(np.float32))
    assert (deviations(place(runner, thin)) > 1.2 * good).all()
    hidden = np.zeros(seen.view.mask.shape, bool)
    hidden[:, 165:] = True
    half = object_views.view(BRACKET, TRUTH, noise_m=0.001, hidden=hidden)
    assert (deviations(place(runner, half, gain=1.0)) > 1.05 * good).all()


def test_errors_that_neighbours_share_count_less(runner):
    """A dent of 4 mm over part of the surface says that the shape is wrong; noise of the same size averages out."""
    seen = object_views.view(BOX, TRUTH)
    rows, columns = np.nonzero(seen.view.mask)
    part = np.zeros(seen.view.mask.shape, bool)
    part[rows, columns] = columns < np.median(columns)
    depth = seen.measured.depth.depth + np.where(part, 0.004, -0.004).astype(np.float32) * seen.view.mask
    dented = object_views.changed(seen, depth=depth.astype(np.float32))
    white = object_views.view(BOX, TRUTH, noise_m=0.004)
    found = [deviations(place(runner, one, mesh=BOX, gain=1.0)) for one in (white, dented)]
    assert (found[1] > 1.5 * found[0]).all()


def test_a_search_that_stops_too_early_states_what_is_left(runner):
    seen = object_views.view(BRACKET, TRUTH, noise_m=0.001)
    best = deviations(place(runner, seen, gain=1.0))
    off = place(runner, seen, factories.pose(0.024, 0.03, 0.0, 0.6), gain=1.0)
    assert off.method.startswith("guess kept")
    assert 0.002 < deviations(off)[0] < 0.006, "4 mm along x"
    assert best[0] < 0.0005


def test_the_turn_of_a_round_body_is_unknown(runner):
    bowl = object_views.mesh(object_views.bowl())
    placed = place(runner, object_views.view(bowl, TRUTH, noise_m=0.001), mesh=bowl)
    assert placed.ambiguous
    assert deviations(placed)[2] > 1.5
    assert deviations(placed)[0] < 0.002


def test_the_shape_s_own_frame_and_the_support_add_to_the_pose(runner):
    seen = object_views.view(BRACKET, TRUTH, noise_m=0.001)
    alone = place(runner, seen).pose.covariance
    body = object_views.body(BRACKET, TRUTH)
    own = np.diag([1e-6, 4e-6, 0.0, 0.0, 0.0, 1e-4])
    body = body.model_copy(update={"pose": body.pose.model_copy(update={"covariance": own})})
    found = runner.run("align.object", body=body, **object_views.sights(seen)).pose.covariance
    assert np.allclose(found - alone, own, atol=1e-12)
    of_camera = np.diag([0.0, 0.0, 4e-6, 1e-6, 1e-6, 0.0])
    camera_pose = seen.measured.camera_pose.model_copy(update={"covariance": of_camera})
    stood = seen.model_copy(update={"measured": seen.measured.model_copy(update={"camera_pose": camera_pose})})
    more = place(runner, stood).pose.covariance - alone
    assert more[2, 2] > 4e-6, "the height, also by the tilt"
    assert np.allclose(np.diag(more)[[0, 1, 5]], 0.0, atol=1e-15), "the camera sees these"


def test_what_cannot_tell_says_nothing(runner):
    seen = object_views.view(BOX, TRUTH)
    body = object_views.body(BOX, TRUTH)
    stub = runner.run("align.object", body=body, **object_views.sights(seen), backend="stub")
    blind = runner.run("align.object", body=body, view=seen.view, support=factories.support())
    for placed in (stub, blind):
        assert placed.pose.covariance is None
        assert placed.scale_sigma is None


def test_the_support_is_as_certain_as_its_depth(runner):
    poses = [
        runner.run("align.support", **factories.shot(tabletops.tabletop(noise=noise).capture)).camera_pose
        for noise in (0.5, 4.0)
    ]
    good, bad = (pose.covariance for pose in poses)
    assert np.linalg.matrix_rank(good, tol=1e-15) == 3, "height and two tilts"
    assert np.sqrt(bad[2, 2]) > 1.5 * np.sqrt(good[2, 2]) > 0.0
    truth = tabletops.EYE[2, 3]
    for pose in poses:
        assert abs(pose.matrix[2, 3] - truth) < 3.0 * np.sqrt(pose.covariance[2, 2])
