"""3D Gaussians as arrays (Kerbl et al. 2023): their covariances, and similarity transforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.gaussians import spherical_harmonics
from dextera_build.geometry import quaternions, transforms


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians in one frame, float64."""

    means: np.ndarray  # (N, 3) means [m]
    rotations: np.ndarray  # (N, 4) unit quaternions, w x y z: axes of the ellipsoid in the frame
    scales: np.ndarray  # (N, 3) standard deviation along its axes [m], > 0
    opacities: np.ndarray  # (N,) 0..1
    harmonics: np.ndarray  # (N, K, 3) coefficients of red, green, blue; 0.5 + their sum is sRGB 0..1

    def __getitem__(self, chosen: np.ndarray | slice) -> Gaussians:
        """A subset."""
        return Gaussians(
            self.means[chosen],
            self.rotations[chosen],
            self.scales[chosen],
            self.opacities[chosen],
            self.harmonics[chosen],
        )

    def __len__(self) -> int:
        """Their number."""
        return len(self.means)


def covariances(gaussians: Gaussians) -> np.ndarray:
    """R S S^T R^T of each, (N, 3, 3) [m^2]."""
    half = turns(gaussians.rotations) * gaussians.scales[:, None, :]
    return np.asarray(half @ half.transpose(0, 2, 1))


def turns(rotations: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) of unit quaternions (N, 4), w x y z."""
    w, x, y, z = rotations.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def moved(gaussians: Gaussians, matrix: np.ndarray, scale: float = 1.0) -> Gaussians:
    """X' = matrix @ [scale * X, 1] of every Gaussian; view-dependent colours are rotated, too.

    Args:
        gaussians: In the child frame.
        matrix: (4, 4) rigid motion, applied after the scale.
        scale: > 0.
    """
    turn = quaternions.from_matrix(matrix[:3, :3])
    colours = spherical_harmonics.rotation(matrix[:3, :3], gaussians.harmonics.shape[1])
    return Gaussians(
        transforms.apply(matrix, scale * gaussians.means),
        quaternions.multiply(turn, gaussians.rotations),
        scale * gaussians.scales,
        gaussians.opacities,
        np.einsum("jk,nkc->njc", colours, gaussians.harmonics),
    )


def colours(gaussians: Gaussians, eye: np.ndarray) -> np.ndarray:
    """Colours towards `eye` (3,) [m]: sRGB (N, 3), not negative."""
    ray = gaussians.means - eye
    ray = ray / np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-300)
    values = spherical_harmonics.basis(ray, gaussians.harmonics.shape[1])
    return np.asarray(np.maximum(0.5 + np.einsum("nk,nkc->nc", values, gaussians.harmonics), 0.0))
