"""Eq. 1 piece by piece: steps, derivatives, invariances, and the honesty of its covariance."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import photo_terms, surface_term, transforms
from dextera_build.geometry.cameras import backproject
from dextera_build.geometry.lie import rotation
from dextera_build.geometry.photo_terms import SAME, Drawn, Exposure, exposure, photometric
from dextera_build.geometry.scene_alignment import Level, Problem, align, align_sparse
from dextera_build.geometry.scene_pose import ScenePose, flow, nearing
from dextera_build.geometry.scene_terms import Correspondences, Weights, sparse
from dextera_build.geometry.uncertainty import invert
from tests.installed import needs

needs("scipy")

K = np.array([[266.0, 0, 159.5], [0, 266.0, 119.5], [0, 0, 1]])
SIZE = (240, 320)
UNIT = 2.0
SCALE = 0.37
POSE = ScenePose(transforms.rigid(rotation(np.array([0.05, -0.1, 0.03])), np.array([0.2, -0.1, 0.3])), SCALE)


def error(found: ScenePose, true: ScenePose) -> np.ndarray:
    """The step (7,) from `found` to `true`, of first order."""
    motion = true.camera_from_scene @ transforms.invert(found.camera_from_scene)
    skew = (motion[:3, :3] - motion[:3, :3].T) / 2
    turn = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return np.concatenate([motion[:3, 3] / UNIT, turn, [np.log(true.scale / found.scale)]])


def draws(seed: int, count: int, true: ScenePose = POSE, noise: float = 1.0) -> Correspondences:
    """Points over the picture: heavy-tailed pixels, depths whose noise grows with the square of the depth."""
    random = np.random.default_rng(seed)
    pixels, z = random.uniform((0, 0), (SIZE[1] - 1, SIZE[0] - 1), (count, 2)), random.uniform(1, 3.5, count)
    seen = np.c_[(pixels - K[:2, 2]) / K[0, 0] * z[:, None], z]
    anchors = transforms.apply(true.scene_from_camera, seen / true.scale)
    depths = z + noise * random.normal(0, 0.0025 * z**2)
    return Correspondences(anchors, pixels + noise * 0.5 * random.standard_t(4, (count, 2)), depths)


def test_steps_are_those_of_a_similarity():
    step = np.array([1e-6, 2e-6, -2e-6, 2e-6, -1e-6, 3e-6, 3e-6])
    moved = POSE.moved(step, UNIT)
    jacobian_column = POSE.covariance(np.outer(step, step), UNIT)
    change = np.concatenate([moved.matrix[:3, 3] - POSE.matrix[:3, 3], step[3:6], [np.log(moved.scale / POSE.scale)]])
    assert np.allclose(jacobian_column, np.outer(change, change), atol=1e-16)
    turn = moved.matrix[:3, :3] @ POSE.matrix[:3, :3].T
    assert np.allclose(turn, rotation(step[3:6]), atol=1e-12)


def test_the_step_to_another_pose_leads_there():
    step = np.array([0.4, -0.2, 0.3, 0.2, -0.3, 0.1, -0.5])
    assert np.allclose(POSE.step_to(POSE.moved(step, UNIT), UNIT), step, atol=1e-9)


def test_the_scale_is_applied_to_the_scene_before_the_motion():
    """Trap 6: X_W = T_W_C (T_G_C)^-1 with s applied to G first; applied to the camera, the scale flips sides."""
    point = np.array([[1.0, 2.0, 5.0]])
    metric = transforms.apply(POSE.matrix, POSE.scale * point)
    assert np.allclose(metric, POSE.scale * POSE.seen(point))
    assert not np.allclose(metric, POSE.scale * transforms.apply(POSE.matrix, point))
    covariance = np.diag([1.0, 2, 3, 4, 5, 6, 7.0])
    there = invert(POSE.matrix, covariance, POSE.scale)  # T_G_C of the scaled scene comes from the usual inverse
    assert there.shape == (7, 7)


@pytest.mark.parametrize("axis", range(7))
def test_flow_and_depth_are_derivatives(axis):
    points = np.random.default_rng(0).uniform((-1, -1, 4), (1, 1, 6), (20, 3))
    step = np.zeros(7)
    step[axis] = 1e-6

    def at(pose: ScenePose) -> tuple[np.ndarray, np.ndarray]:
        seen = pose.seen(points)
        return seen[:, :2] / seen[:, 2:] * K[0, 0], pose.scale * seen[:, 2]

    (after, far), (before, near) = at(POSE.moved(step, UNIT)), at(POSE.moved(-step, UNIT))
    seen = POSE.seen(points)
    assert np.allclose((after - before) / 2e-6, flow(seen, K, UNIT)[:, :, axis], atol=1e-4)
    assert np.allclose((far - near) / 2e-6, nearing(seen, POSE.scale, UNIT)[:, axis], atol=1e-6)


def test_pixels_say_nothing_about_the_scale_and_depth_does():
    """Trap 22: with (s, t) together, pictures do not change; without depths the scale has no anchor at all."""
    matches = draws(0, 80)
    blind = Correspondences(matches.anchors, matches.pixels, np.zeros(len(matches)))
    step = np.array([0, 0, 0, 0, 0, 0, 0.3])
    there, away = (sparse(pose, blind, K, SIZE, Weights(), UNIT).value for pose in (POSE, POSE.moved(step, UNIT)))
    assert there == away
    assert sparse(POSE.moved(step, UNIT), matches, K, SIZE, Weights(), UNIT).value > 1.1 * away
    known, unknown = (align_sparse(POSE, each, K, SIZE, Weights(), UNIT).condition for each in (matches, blind))
    assert known < 1e4
    assert unknown > 1e10


def test_the_sparse_terms_find_theta_from_afar():
    start = POSE.moved(np.array([0.05, 0.1, -0.1, 0.1, -0.1, 0.15, 0.4]), UNIT)
    found = align_sparse(start, draws(1, 60, noise=0.0), K, SIZE, Weights(), UNIT)
    assert np.abs(error(found.pose, POSE)).max() < 1e-5


@pytest.mark.medium
@pytest.mark.parametrize("count", [120, 300])
def test_the_stated_covariance_is_honest(count):
    """The 95 % region of 300 draws holds 92 to 98 %, with heavy tails and noise that no weight knows."""
    from scipy.stats import chi2

    held = 0
    for seed in range(300):
        start = POSE.moved(np.random.default_rng(seed).normal(0, 0.01, 7), UNIT)
        found = align_sparse(start, draws(1000 + seed, count), K, SIZE, Weights(), UNIT)
        off = error(found.pose, POSE)
        held += off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.95, 7)
    assert 0.92 <= held / 300 <= 0.98


def wall(pose: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
    """A wavy painted surface z = 5 + sin(x) in lengths of G, by Newton's method along each ray."""
    rays = backproject(np.ones(size), k) @ pose[:3, :3].T
    eye = pose[:3, 3]
    t = np.full(size, 5.0)
    for _ in range(30):
        place = eye + t[..., None] * rays
        off = place[..., 2] - 5 - 0.5 * np.sin(place[..., 0])
        t -= off / (rays[..., 2] - 0.5 * np.cos(place[..., 0]) * rays[..., 0])
    x, y, _ = np.moveaxis(eye + t[..., None] * rays, -1, 0)
    paint = [np.sin(3 * x + y) * np.cos(2.5 * y), np.sin(2 * x - 3 * y), np.cos(4 * x) * np.sin(y + 1)]
    return Drawn(0.5 + 0.35 * np.stack(paint, axis=-1), t, np.ones(size))


TRUE = ScenePose(POSE.camera_from_scene, SCALE)


def photo(light: Exposure = SAME) -> tuple[np.ndarray, np.ndarray]:
    drawn = wall(TRUE.scene_from_camera, K, SIZE)
    return light.of(drawn.rgb), drawn.depth * SCALE


@pytest.mark.medium
@pytest.mark.parametrize("part", ["rgb", "ssim", "surface"])
def test_photometric_slopes_are_derivatives(part):
    weights = Weights(rgb=float(part == "rgb"), ssim=float(part == "ssim"), surface=float(part == "surface"))
    rgb, depth = photo()
    valid = np.zeros(SIZE, bool)
    valid[30:200, 40:280] = True
    here = TRUE.moved(np.array([0.003, -0.004, 0.006, 0.004, -0.006, 0.01, 0.005]), UNIT)

    def at(pose: ScenePose) -> photo_terms.Terms:
        drawn = wall(pose.scene_from_camera, K, SIZE)
        found = photometric(drawn, rgb, valid, K, weights, UNIT, SAME)
        return found + surface_term.surface(drawn, pose.scale, depth, valid, K, weights, UNIT)

    gradient = at(here).gradient
    steps = 1e-4 * np.eye(7)[:6]
    slopes = [(at(here.moved(step, UNIT)).value - at(here.moved(-step, UNIT)).value) / 2e-4 for step in steps]
    assert gradient[:6] == pytest.approx(slopes, rel=0.05, abs=0.02 * np.abs(gradient).max())


def test_the_mean_does_not_grow_with_omega():
    """Trap 21: a sum over Omega would trade pose against the size of the mask."""
    rgb, _ = photo()
    drawn = wall(TRUE.moved(np.full(7, 0.01), UNIT).scene_from_camera, K, SIZE)
    few, many = np.zeros(SIZE, bool), np.ones(SIZE, bool)
    few[60:180, 80:240] = True
    one, other = (photometric(drawn, rgb, each, K, Weights(), UNIT, SAME).value for each in (few, many))
    assert other == pytest.approx(one, rel=0.5)


def levels(rgb: np.ndarray, depth: np.ndarray) -> list[Level]:
    half = K.copy()
    half[:2] /= 2
    half[:2, 2] -= 0.25  # trap 20: integer pixel centres lie half a pixel inside
    small = rgb.reshape(120, 2, 160, 2, 3).mean(axis=(1, 3))
    return [Level(small, depth[::2, ::2], depth[::2, ::2] > 0, half), Level(rgb, depth, depth > 0, K)]


CLEAN = Weights(rgb=300.0, ssim=3.0, pixel=1.0, depth=0.4)
"""For pictures without noise, in which colours tell more than twelve points."""


@pytest.mark.medium
@pytest.mark.parametrize("light", [SAME, Exposure(np.array([0.7, 0.75, 0.6]), np.array([0.05, 0.1, 0.02]))])
def test_all_terms_find_theta_whatever_the_exposure(light):
    """Trap 21: the exposure is a nuisance that is solved for, so it does not move the camera."""
    rgb, depth = photo(light)
    matches = draws(3, 12, TRUE, noise=0.5)
    start = TRUE.moved(np.array([0.01, -0.01, 0.01, 0.01, -0.01, 0.01, 0.05]), UNIT)
    found = align(start, Problem(matches, K, SIZE, levels(rgb, depth), wall, CLEAN, UNIT, 0.2))
    alone = align_sparse(start, matches, K, SIZE, CLEAN, UNIT)
    assert np.linalg.norm(error(found.pose, TRUE)) < 0.5 * np.linalg.norm(error(alone.pose, TRUE))
    assert np.abs(error(found.pose, TRUE)).max() < 3e-3


@pytest.mark.medium
def test_black_holes_do_not_attract():
    """Trap 21: where G shows nothing it is painted black, and black must not count."""
    rgb, depth = photo()

    def holed(pose: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
        drawn = wall(pose, k, size)
        place = pose[:3, 3] + drawn.depth[..., None] * (backproject(np.ones(size), k) @ pose[:3, :3].T)
        there = np.abs(place[..., 0] % 1.2 - 0.6) > 0.12
        return Drawn(drawn.rgb * there[..., None], np.where(there, drawn.depth, 0.0), there.astype(float))

    start = TRUE.moved(np.array([0.01, -0.01, 0.01, 0.01, -0.01, 0.01, 0.03]), UNIT)
    matches = draws(4, 12, TRUE, noise=0.5)
    found = align(start, Problem(matches, K, SIZE, levels(rgb, depth), holed, CLEAN, UNIT, 0.2))
    assert np.abs(error(found.pose, TRUE)).max() < 2e-3


def test_an_exposure_is_found():
    light = Exposure(np.array([0.7, 1.2, 0.9]), np.array([0.1, -0.05, 0.0]))
    drawn = wall(TRUE.scene_from_camera, K, SIZE)
    found = exposure(drawn, light.of(drawn.rgb), np.ones(SIZE, bool))
    assert np.allclose(found.gain, light.gain, atol=1e-6)
    assert np.allclose(found.offset, light.offset, atol=1e-6)
