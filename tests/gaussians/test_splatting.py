"""Pictures of Gaussians: as a slow renderer draws them, and unchanged when world and camera move together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.gaussians import arrays as shapes
from dextera_build.gaussians import splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import basis
from dextera_build.geometry import transforms
from tests import factories

SIZE = (60, 80)
K = np.array([[75.0, 0, 38.0], [0, 80.0, 31.0], [0, 0, 1]])
POSE = factories.look_at((-1.2, -1.5, 0.9))


def one(**fields: np.ndarray) -> Gaussians:
    """A round Gaussian of 2 cm in front of the camera, of one grey."""
    given = {
        "means": np.zeros((1, 3)),
        "rotations": np.array([[1.0, 0, 0, 0]]),
        "scales": np.full((1, 3), 0.02),
        "opacities": np.array([0.8]),
        "harmonics": np.full((1, 1, 3), 0.3 / basis(np.array([[0.0, 0, 1]]), 1)[0, 0]),
    }
    return Gaussians(**given | fields)


def test_a_round_one_is_a_bell_on_the_picture():
    pose = transforms.rigid(np.eye(3), np.array([0.0, 0.0, -2.0]))
    k = np.array([[400.0, 0, 38.0], [0, 400.0, 31.0], [0, 0, 1]])
    picture = splatting.render(one(), k, pose, SIZE)
    variance = (400 * 0.02 / 2) ** 2 + 0.3
    for row, column in ((31, 38), (31, 42), (25, 38), (34, 41)):
        distance = (row - 31) ** 2 + (column - 38) ** 2
        assert picture[row, column] == pytest.approx(0.8 * 0.8 * np.exp(-distance / variance / 2), rel=1e-6)
    assert picture[0, 0] == pytest.approx(0)


def test_what_is_in_front_hides_what_is_behind():
    pose = transforms.rigid(np.eye(3), np.array([0.0, 0.0, -2.0]))
    means = np.array([[0.0, 0, 1], [0, 0, 0]])
    both = one(
        means=means,
        rotations=np.tile([1.0, 0, 0, 0], (2, 1)),
        scales=np.full((2, 3), 0.1),
        opacities=np.array([0.9, 0.6]),
        harmonics=np.array([[[0.3, 0, 0]], [[0, 0, 0.3]]]),
    )
    far, near = 0.5 + np.array([[0.3, 0, 0], [0, 0, 0.3]]) * basis(np.array([[0.0, 0, 1]]), 1)[0, 0]
    middle = splatting.render(both, K, pose, SIZE, paper=0.25)[31, 38]
    assert middle == pytest.approx(0.6 * near + 0.4 * (0.9 * far + 0.1 * 0.25), rel=1e-12)


def by_pixel(made: Gaussians, k: np.ndarray, pose: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The same picture, one pixel and one Gaussian after the other."""
    places = (made.means - pose[:3, 3]) @ pose[:3, :3]
    spread, shown = shapes.covariances(made), shapes.colours(made, pose[:3, 3])
    picture = np.zeros((*size, 3))
    light = np.ones(size)
    for i in np.argsort(places[:, 2]):
        x, y, z = places[i]
        limits = [1.3 * side / 2 / focal for side, focal in ((size[1], k[0, 0]), (size[0], k[1, 1]))]
        u, v = np.clip(x / z, -limits[0], limits[0]), np.clip(y / z, -limits[1], limits[1])
        jacobian = np.array([[k[0, 0] / z, 0, -k[0, 0] * u / z], [0, k[1, 1] / z, -k[1, 1] * v / z]])
        flat = jacobian @ pose[:3, :3].T @ spread[i] @ pose[:3, :3] @ jacobian.T + 0.3 * np.eye(2)
        for row in range(size[0]):
            for column in range(size[1]):
                off = np.array([column - k[0, 2] - k[0, 0] * x / z, row - k[1, 2] - k[1, 1] * y / z])
                alpha = min(made.opacities[i] * np.exp(-off @ np.linalg.solve(flat, off) / 2), 0.99)
                if alpha >= 1 / 255:
                    picture[row, column] += light[row, column] * alpha * shown[i]
                    light[row, column] *= 1 - alpha
    return picture


def test_it_draws_what_a_slow_renderer_draws(monkeypatch):
    made = factories.gaussians(12)
    slow = by_pixel(made, K, POSE, SIZE)
    assert slow.max() > 0.3
    assert np.abs(splatting.render(made, K, POSE, SIZE) - slow).max() < 1e-12
    monkeypatch.setattr(splatting, "_PAIRS", 50)  # several runs, one after the other
    assert np.abs(splatting.render(made, K, POSE, SIZE) - slow).max() < 1e-12


def psnr(first: np.ndarray, second: np.ndarray) -> float:
    error = ((first.clip(0, 1) - second.clip(0, 1)) ** 2).mean()
    return float(-10 * np.log10(max(error, 1e-300)))


@pytest.mark.parametrize("scale", [0.05, 1.0, 37.0])
def test_moving_world_and_camera_together_changes_nothing(scale):
    made = factories.gaussians(500)
    before = splatting.render(made, K, POSE, SIZE)
    motion = transforms.rigid(Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix(), np.array([3.0, -5.0, 2.0]))
    camera = transforms.rigid(motion[:3, :3] @ POSE[:3, :3], transforms.apply(motion, scale * POSE[:3, 3]))
    moved = shapes.moved(made, motion, scale)
    assert psnr(before, splatting.render(moved, K, camera, SIZE)) > 200
    # If the colours did not turn along, they would be seen from another side.
    assert psnr(before, splatting.render(replace(moved, harmonics=made.harmonics), K, camera, SIZE)) < 31


def test_what_is_behind_the_camera_or_clear_is_not_drawn():
    pose = transforms.rigid(np.eye(3), np.array([0.0, 0.0, 2.0]))
    assert not splatting.render(one(), K, pose, SIZE).any()
    assert not splatting.render(one(opacities=np.array([0.003])), K, POSE, SIZE).any()
    nothing = factories.gaussians(0)
    assert (splatting.render(nothing, K, POSE, SIZE, paper=0.5) == 0.5).all()


def test_a_preview_is_the_same_at_every_scale(monkeypatch):
    made = factories.gaussians(300)
    large = splatting.preview(shapes.moved(made, np.eye(4), 1000.0))
    assert np.abs(splatting.preview(made).astype(int) - large).max() <= 1
    assert (large != 255).any(axis=2).mean() > 0.1
    assert (splatting.preview(factories.gaussians(0)) == 255).all()
    monkeypatch.setattr(splatting, "_PREVIEW", 30)
    few = splatting.preview(made)
    assert 0.01 < (few != 255).any(axis=2).mean() < (large != 255).any(axis=2).mean()
