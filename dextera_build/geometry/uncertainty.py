"""First-order propagation of covariance through rigid motions and similarities.

An uncertain motion is a known one after a small twist of `geometry.lie`; covariances are (6, 6), or (7, 7) with the
logarithm of a scale. The first six are those of `geometry_msgs/PoseWithCovariance`. Combined motions are assumed to be
independent; `intersected` is for estimates of one motion whose common errors are unknown.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, transforms


def compose(
    first: np.ndarray, second: np.ndarray, covariances: tuple[np.ndarray, np.ndarray], scale: float = 1.0
) -> np.ndarray:
    """Covariance of T_a_b composed with T_b_c.

    Args:
        first: T_a_b, (4, 4) rigid.
        second: T_b_c, (4, 4) rigid.
        covariances: Covariances of both, (6, 6), or (7, 7) for similarities.
        scale: Scale of the first, which also scales the translation of the second.
    """
    size = len(covariances[0])
    rotation, arm = first[:3, :3], scale * first[:3, :3] @ second[:3, 3]
    by_first, by_second = lie.adjoint(arm, size), np.eye(size)
    by_second[:3, :3] = scale * rotation
    by_second[3:6, 3:6] = rotation
    return _symmetric(by_first @ covariances[0] @ by_first.T + by_second @ covariances[1] @ by_second.T)


def invert(motion: np.ndarray, covariance: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Covariance of the inverse of T_a_b.

    Args:
        motion: T_a_b, (4, 4) rigid.
        covariance: Covariance of T_a_b, (6, 6), or (7, 7) for a similarity.
        scale: Its scale.
    """
    back, size = motion[:3, :3].T, len(covariance)
    jacobian = -np.eye(size)
    jacobian[:3, :3] = -back / scale
    jacobian[:3, 3:6] = -back @ transforms.cross_matrix(motion[:3, 3]) / scale
    jacobian[3:6, 3:6] = -back
    if size == 7:
        jacobian[:3, 6] = back @ motion[:3, 3] / scale
    return _symmetric(jacobian @ covariance @ jacobian.T)


def intersected(first: np.ndarray, second: np.ndarray, cost: np.ndarray) -> tuple[float, np.ndarray]:
    """Covariance intersection of two estimates (Julier and Uhlmann 1997), consistent however their errors correlate.

    With the weight w of the second, the combined covariance is P = (w inv(second) + (1 - w) inv(first))^-1, and the
    combined deviation from the first estimate is w P inv(second) times that of the second. A second estimate that
    improves nothing has the weight 0.

    Args:
        first: Covariance (6, 6) of the first estimate.
        second: Covariance (6, 6) of the second.
        cost: (6, 6); the weight minimises the trace of cost @ P.

    Returns:
        The weight w of the second estimate, 0..1, and P.
    """
    from scipy.optimize import minimize_scalar

    one, two = np.linalg.inv(first), np.linalg.inv(second)

    def combined(weight: float) -> np.ndarray:
        return np.linalg.inv(weight * two + (1.0 - weight) * one)

    def costs(weight: float) -> float:
        return float(np.trace(cost @ combined(weight)))

    inner = float(minimize_scalar(costs, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-4}).x)
    weight = min((0.0, inner, 1.0), key=costs)
    return weight, _symmetric(combined(weight))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return np.asarray((matrix + matrix.T) / 2)
