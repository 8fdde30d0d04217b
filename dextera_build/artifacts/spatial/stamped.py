"""Time-stamped poses: checks, interpolation, and covariances in text files."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.spatial.pose import check_covariance
from dextera_build.errors import ArtifactError
from dextera_build.geometry import quaternions


def check(kind: str, stamps: np.ndarray, poses: np.ndarray, covariances: np.ndarray | None) -> None:
    """Raise for stamps that do not increase, quaternions without unit length, and invalid covariances.

    Args:
        kind: The type, for messages.
        stamps: (N,) [s].
        poses: (N, 7), position [m] and quaternion w x y z; rows of NaN are unknown.
        covariances: (N, 6, 6), or None.

    Raises:
        ArtifactError: One of these.
    """
    check_stamps(kind, stamps)
    length = np.linalg.norm(poses[:, 3:], axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > 1e-6)
    if len(bad):
        raise ArtifactError(
            f"{kind}.poses: {len(bad):,} of {len(poses):,} quaternions are of another length than 1",
            code="DXB-A502",
            facts={"first": f"row {bad[0]}, length {length[bad[0]]:.6g}"},
            hint="divide each by its length; the order is x y z [m], then w x y z",
        )
    for index, covariance in enumerate(() if covariances is None else covariances):
        check_covariance(f"{kind} at {stamps[index]} s", covariance)


def check_stamps(kind: str, stamps: np.ndarray) -> None:
    """Raise for stamps (N,) [s] that do not increase.

    Raises:
        ArtifactError: A stamp is not later than the one before.
    """
    wrong = np.flatnonzero(np.diff(stamps) <= 0)
    if len(wrong):
        first = int(wrong[0])
        raise ArtifactError(
            f"{kind}.stamps do not increase",
            code="DXB-A501",
            facts={"first": f"{stamps[first + 1]!r} s comes after {stamps[first]!r} s", "places": len(wrong)},
            hint="sort the poses by time, and leave out those with equal stamps",
        )


def between(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """The pose (7,) at fraction `share`: linear in position, spherical linear (slerp) in rotation."""
    return np.append((1 - share) * first[:3] + share * second[:3], quaternions.slerp(first[3:], second[3:], share))
