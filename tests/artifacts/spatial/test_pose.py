"""Poses: frames and times that must fit, and covariances compared with samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.errors import ArtifactError

SAMPLES = 200_000


def motion(random: np.random.Generator) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=random).as_matrix()
    matrix[:3, 3] = random.normal(size=3)
    return matrix


def covariance(random: np.random.Generator, size: int) -> np.ndarray:
    """Of millimetres and milliradians, with correlations."""
    spread = 1e-3 * random.normal(size=(size, size))
    return spread @ spread.T


def sampled(pose: Pose | Similarity, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations (S, 3, 3), translations (S, 3) and scales (S,) around a pose, by the definition of its covariance."""
    assert pose.covariance is not None
    noise = random.multivariate_normal(np.zeros(len(pose.covariance)), pose.covariance, SAMPLES)
    turns = Rotation.from_rotvec(noise[:, 3:6]).as_matrix() @ pose.matrix[:3, :3]
    scale = getattr(pose, "scale", 1.0) * np.exp(noise[:, 6] if noise.shape[1] == 7 else np.zeros(SAMPLES))
    return turns, pose.matrix[:3, 3] + noise[:, :3], scale


def measured(pose: Pose | Similarity, turns: np.ndarray, shifts: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Covariance of samples around a pose."""
    turned = Rotation.from_matrix(turns @ pose.matrix[:3, :3].T).as_rotvec()
    parts = [shifts - pose.matrix[:3, 3], turned]
    if isinstance(pose, Similarity):
        parts.append(np.log(scales / pose.scale)[:, None])
    return np.cov(np.hstack(parts).T)


def pair(kind: type[Any], random: np.random.Generator) -> tuple[Any, Any]:
    size = 6 if kind is Pose else 7
    scales = [{}, {}] if kind is Pose else [{"scale": 0.5}, {"scale": 3.0}]
    return tuple(  # type: ignore[return-value]
        kind(parent=a, child=b, matrix=motion(random), covariance=covariance(random, size), **scale)
        for a, b, scale in (("a", "b", scales[0]), ("b", "c", scales[1]))
    )


@pytest.mark.medium
@pytest.mark.parametrize("kind", [Pose, Similarity])
@pytest.mark.parametrize("seed", range(3))
def test_the_covariance_of_a_composition_is_that_of_samples(kind: type[Any], seed: int) -> None:
    random = np.random.default_rng(seed)
    first, second = pair(kind, random)
    (r1, p1, s1), (r2, p2, s2) = sampled(first, random), sampled(second, random)
    composed = first @ second
    shifts = p1 + s1[:, None] * np.einsum("nij,nj->ni", r1, p2)
    found = measured(composed, r1 @ r2, shifts, s1 * s2)
    assert np.abs(found - composed.covariance).max() < 0.02 * np.abs(composed.covariance).max()


@pytest.mark.parametrize("kind", [Pose, Similarity])
@pytest.mark.parametrize("seed", range(3))
def test_the_covariance_of_an_inverse_is_that_of_samples(kind: type[Any], seed: int) -> None:
    random = np.random.default_rng(seed)
    pose, _ = pair(kind, random)
    turns, shifts, scales = sampled(pose, random)
    back = np.swapaxes(turns, 1, 2)
    found = measured(pose.inverse(), back, -np.einsum("nij,nj->ni", back, shifts) / scales[:, None], 1 / scales)
    assert np.abs(found - pose.inverse().covariance).max() < 0.02 * np.abs(found).max()


@pytest.mark.parametrize("kind", [Pose, Similarity])
def test_composition_is_associative_and_an_inverse_undoes_it(kind: type[Any]) -> None:
    random = np.random.default_rng(3)
    first, second = pair(kind, random)
    third = kind(**{**{n: getattr(first, n) for n in kind.model_fields}, "parent": "c", "child": "d"})
    one, other = (first @ second) @ third, first @ (second @ third)
    np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-12)
    np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-12)
    np.testing.assert_allclose((first @ first.inverse()).matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(first.inverse().inverse().covariance, first.covariance, atol=1e-15)


def test_what_is_exact_adds_nothing() -> None:
    random = np.random.default_rng(4)
    first, second = pair(Pose, random)
    exact = Pose(parent="c", child="d", matrix=np.eye(4))
    np.testing.assert_allclose((second @ exact).covariance, second.covariance)
    assert (exact @ Pose(parent="d", child="e", matrix=np.eye(4))).covariance is None
    assert (first @ second).covariance is not None


def test_points_of_unknown_scale_come_to_metres() -> None:
    random = np.random.default_rng(5)
    first, second = pair(Similarity, random)
    points = random.normal(size=(4, 3))

    def moved(by: Similarity, these: np.ndarray) -> np.ndarray:
        return np.asarray(by.scale * these @ by.matrix[:3, :3].T + by.matrix[:3, 3])

    np.testing.assert_allclose(moved(first @ second, points), moved(first, moved(second, points)), atol=1e-12)
    np.testing.assert_allclose(moved(first.inverse(), moved(first, points)), points, atol=1e-12)


def rigid(**more: Any) -> Pose:
    return Pose(**{"parent": "a", "child": "b", "matrix": np.eye(4), **more})


LOPSIDED = np.eye(6)
LOPSIDED[0, 1] = 0.5
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: rigid() @ rigid(), "T_a_b cannot be followed by T_a_b"),
        (lambda: rigid(stamp=1.0) @ rigid(parent="b", child="c", stamp=2.0), "hold at different times"),
        (lambda: rigid(covariance=LOPSIDED), "the covariance of T_a_b is not symmetric"),
        (lambda: rigid(covariance=-np.eye(6)), "positive semi-definite"),
        (lambda: rigid(matrix=MIRROR), "T_a_b is not a rigid motion: it mirrors"),
        (lambda: rigid(matrix=np.full((4, 4), 1e300)), "T_a_b is not a rigid motion"),
        (lambda: rigid(matrix=np.eye(4) + np.eye(4, k=-3)), "T_a_b is not a rigid motion"),
        (lambda: Similarity(parent="a", child="b", matrix=np.eye(4), scale=0.0), "T_a_b has the scale 0"),
        (lambda: Similarity(parent="a", child="b", matrix=np.eye(4), scale=float("nan")), "T_a_b has the scale nan"),
    ],
)
def test_what_is_no_pose_is_refused(make, said) -> None:
    with pytest.raises(ArtifactError) as caught:
        make()
    assert said in caught.value.message


def test_a_stamp_is_kept() -> None:
    later = rigid(stamp=2.5)
    assert (later @ rigid(parent="b", child="c")).stamp == 2.5
    assert (rigid(parent="z", child="a") @ later).stamp == 2.5
    assert later.inverse().stamp == 2.5
