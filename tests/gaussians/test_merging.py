"""Gaussians that lie together in a pixel become one: what is kept, and what the picture then shows."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.merging import merged
from dextera_build.geometry import cameras, transforms
from dextera_build.geometry.lie import rotation

K = np.array([[200.0, 0, 79.5], [0, 200.0, 59.5], [0, 0, 1]])
SIZE = (120, 160)
SMALL, SMALL_SIZE = np.array([[50.0, 0, 19.5], [0, 50.0, 14.5], [0, 0, 1]]), (30, 40)
POSE = transforms.rigid(rotation(np.array([0.3, -0.8, 0.5])), np.array([2.0, -1.0, 4.0]))


def wall(noise: float = 0.0, *, flat: bool = False) -> Gaussians:
    """A slanted wall as a camera at POSE measures it: a Gaussian for each pixel, balls or discs that face it."""
    draw = np.random.default_rng(0)
    rays = cameras.rays(*SIZE, K).reshape(-1, 3)
    z = 2.0 / (1.0 - 0.8 * rays[:, 0]) * (1.0 + noise * draw.normal(size=len(rays)))
    scales = np.repeat(0.45 * z[:, None] / K[0, 0], 3, axis=1)
    if flat:
        scales[:, 2] *= 0.1
    turns = np.tile([1.0, 0, 0, 0], (len(z), 1))
    colours = draw.normal(size=(len(z), 1, 3))
    there = Gaussians(rays * z[:, None], turns, scales, np.full(len(z), 0.9), colours)
    return Gaussians(transforms.apply(POSE, there.means), *(getattr(there, name) for name in FIELDS[1:]))


FIELDS = tuple(Gaussians.__dataclass_fields__)


def test_what_is_as_large_as_a_cell_stays_as_it_is() -> None:
    given = wall()
    found = merged(given, K, POSE, SIZE, 0.5)
    assert all(np.array_equal(getattr(found, name), getattr(given, name)) for name in FIELDS)


def test_what_the_camera_does_not_see_is_left_out() -> None:
    behind = transforms.rigid(POSE[:3, :3] @ rotation(np.array([0.0, np.pi, 0.0])), POSE[:3, 3])
    assert len(merged(wall(), K, behind, SIZE, 1.0)) == 0


def test_a_group_is_in_the_middle_of_its_members_and_has_their_mean_colour() -> None:
    """What is linear in the place stays so: a plane, and a ramp of colours."""
    given = wall()
    ramp = given.means @ np.array([[0.1, -0.2, 0.3], [0.2, 0.1, 0.0], [-0.1, 0.3, 0.2]])
    given = Gaussians(given.means, given.rotations, given.scales, given.opacities, ramp[:, None])
    found = merged(given, SMALL, POSE, SMALL_SIZE, 1.0)
    assert len(found) < 1.3 * SMALL_SIZE[0] * SMALL_SIZE[1]
    local = transforms.apply(transforms.invert(POSE), found.means)
    assert np.allclose(local[:, 2] - 0.8 * local[:, 0], 2.0, atol=1e-9)
    assert np.allclose(found.harmonics[:, 0], found.means @ np.linalg.lstsq(given.means, ramp)[0], atol=1e-9)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_groups_cover_as_much_as_their_members_did(noise: float, flat: bool) -> None:
    given = wall(noise, flat=flat)
    found = merged(given, SMALL, POSE, SMALL_SIZE, 1.0)
    before, after = (covered(each).sum() for each in (given, found))
    # No group may reach far into its neighbours, so that few that are left alone at a border cover less.
    assert after == pytest.approx(before, rel=0.25)
    assert after <= 1.001 * before


def covered(given: Gaussians) -> np.ndarray:
    """Opacity times area in the picture, as a part of it."""
    from dextera_build.gaussians.arrays import covariances

    local = POSE[:3, :3].T @ covariances(given) @ POSE[:3, :3]
    x, y, z = transforms.apply(transforms.invert(POSE), given.means).T
    zero = np.zeros(len(z))
    jacobian = np.array([[1 / z, zero, -x / z**2], [zero, 1 / z, -y / z**2]]).transpose(2, 0, 1)
    return np.asarray(given.opacities * np.sqrt(np.linalg.det(jacobian @ local @ jacobian.transpose(0, 2, 1))))
