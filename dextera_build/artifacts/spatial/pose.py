"""Pose of one named frame in another, with its uncertainty and time."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.errors import ArtifactError
from dextera_build.geometry import transforms, uncertainty


class Pose(Artifact):
    """A rigid motion between two named frames: X_parent = matrix @ X_child."""

    parent: str
    """Frame of the resulting coordinates."""
    child: str
    """Frame of the given coordinates."""
    matrix: Annotated[np.ndarray, Array("4 4", "float64", unit="m", frame="parent")]
    """T_parent_child, homogeneous."""
    covariance: Annotated[np.ndarray, Array("6 6", "float64", frame="parent")] | None = None
    """Covariance of translation [m] and rotation vector [rad], see `geometry.uncertainty`; None: exact, or not
    stated."""
    stamp: float | None = None
    """Time at which it is valid [s]; None if it is constant."""

    def __matmul__(self, other: Pose) -> Pose:
        """T_a_c = T_a_b @ T_b_c; covariances are propagated to first order, assuming independence; None is exact.

        Raises:
            ArtifactError: The inner frames or the stamps differ.
        """
        _check_inner(self, other)
        return Pose(
            parent=self.parent,
            child=other.child,
            matrix=self.matrix @ other.matrix,
            covariance=_composed(self, other, 6),
            stamp=_shared_stamp(self, other),
        )

    def sigma(self) -> tuple[float, float] | None:
        """Standard deviation of the position [m] and of the rotation [rad], over all axes; None if not stated."""
        if self.covariance is None:
            return None
        spread = np.diag(self.covariance)
        return float(np.sqrt(spread[:3].sum())), float(np.sqrt(spread[3:].sum()))

    def inverse(self) -> Pose:
        """T_child_parent."""
        covariance = None if self.covariance is None else uncertainty.invert(self.matrix, self.covariance)
        return Pose(
            parent=self.child,
            child=self.parent,
            matrix=transforms.invert(self.matrix),
            covariance=covariance,
            stamp=self.stamp,
        )

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_motion(self)
        return self


class Similarity(Artifact):
    """A rigid motion and a scale between two named frames: X_parent = matrix @ [scale * X_child, 1]."""

    parent: str
    """Frame of the resulting coordinates."""
    child: str
    """Frame of the given coordinates, which may be of unknown scale."""
    matrix: Annotated[np.ndarray, Array("4 4", "float64", unit="m", frame="parent")]
    """Its rigid part, homogeneous, applied after the scale."""
    scale: float
    """Length in the parent frame per length in the child frame."""
    covariance: Annotated[np.ndarray, Array("7 7", "float64", frame="parent")] | None = None
    """Covariance of translation [m], rotation vector [rad] and log scale; None: exact, or not stated."""
    stamp: float | None = None
    """Time at which it is valid [s]; None if it is constant."""

    @classmethod
    def of(cls, matrix: np.ndarray, parent: str, child: str) -> Self:
        """The similarity of a (4, 4) matrix X_parent = matrix @ [X_child, 1].

        Raises:
            ArtifactError: It scales axes differently, shears, mirrors or is not affine.
        """
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        scale = float(np.mean(lengths))
        if not (scale > 0 and np.ptp(lengths) <= 1e-5 * scale):
            shown = ", ".join(f"{length:.4g}" for length in lengths)
            raise ArtifactError(
                f"the axes of a similarity are scaled alike, those of T_{parent}_{child} by {shown}",
                code="DXB-A209",
                hint="scale all axes by one factor: joints between parts that are stretched no longer close",
            )
        rigid = np.array(matrix, np.float64)
        rigid[:3, :3] /= scale
        return cls(parent=parent, child=child, matrix=rigid, scale=scale)

    def __matmul__(self, other: Similarity) -> Similarity:
        """S_a_c = S_a_b @ S_b_c; covariances are propagated to first order, assuming independence; None is exact.

        Raises:
            ArtifactError: The inner frames or the stamps differ.
        """
        _check_inner(self, other)
        second = other.matrix.copy()
        second[:3, 3] *= self.scale
        return Similarity(
            parent=self.parent,
            child=other.child,
            matrix=self.matrix @ second,
            scale=self.scale * other.scale,
            covariance=_composed(self, other, 7, self.scale),
            stamp=_shared_stamp(self, other),
        )

    def inverse(self) -> Similarity:
        """S_child_parent."""
        matrix = transforms.invert(self.matrix)
        matrix[:3, 3] /= self.scale
        covariance = None if self.covariance is None else uncertainty.invert(self.matrix, self.covariance, self.scale)
        return Similarity(
            parent=self.child,
            child=self.parent,
            matrix=matrix,
            scale=1 / self.scale,
            covariance=covariance,
            stamp=self.stamp,
        )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.scale > 0:
            raise ArtifactError(
                f"{_named(self)} has the scale {self.scale:g}", code="DXB-A206", hint="a scale is above 0"
            )
        _check_motion(self)
        return self


def check_frame(kind: str, frame: str, motion: Pose | Similarity) -> None:
    """Raise unless the value to be moved is in the child frame of `motion`.

    Args:
        kind: Kind of the value, for the message.
        frame: Its frame.
        motion: The motion.

    Raises:
        ArtifactError: The frames differ.
    """
    if frame != motion.child:
        raise ArtifactError(
            f"a {kind} in frame `{frame}` cannot be moved by {_named(motion)}",
            code="DXB-A208",
            hint="state its frame, or compose the motion with `@` until its child is that frame",
        )


def check_rigid(name: str, matrix: np.ndarray) -> None:
    """Raise unless the matrix is a rigid motion.

    Args:
        name: Its name in the message.
        matrix: (4, 4), finite.

    Raises:
        ArtifactError: It scales, shears or mirrors.
    """
    rotation = matrix[:3, :3]
    bottom = np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])
    size = np.abs(rotation).max()
    if not (bottom and size < 2 and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)):
        raise ArtifactError(f"{name} is not a rigid motion", code="DXB-A202")
    if np.linalg.det(rotation) < 0:
        raise ArtifactError(f"{name} is not a rigid motion: it mirrors", code="DXB-A202")


def check_covariance(name: str, covariance: np.ndarray) -> None:
    """Raise unless the matrix is symmetric positive semidefinite.

    Args:
        name: Its owner, for the message.
        covariance: (S, S), finite.

    Raises:
        ArtifactError: It is not symmetric positive semidefinite.
    """
    largest = float(np.abs(covariance).max())
    symmetric = np.allclose(covariance, covariance.T, rtol=0, atol=1e-9 * largest)
    if not (symmetric and np.linalg.eigvalsh(covariance)[0] >= -1e-9 * largest):
        raise ArtifactError(f"the covariance of {name} is not symmetric and positive semi-definite", code="DXB-A204")


def _named(motion: Pose | Similarity) -> str:
    return f"T_{motion.parent}_{motion.child}"


def _check_motion(motion: Pose | Similarity) -> None:
    """Raise unless the matrix is a rigid motion and the covariance is valid."""
    check_rigid(_named(motion), motion.matrix)
    covariance = motion.covariance
    if covariance is None:
        return
    check_covariance(_named(motion), covariance)


def _check_inner(first: Pose | Similarity, second: Pose | Similarity) -> None:
    if first.child != second.parent:
        raise ArtifactError(
            f"{_named(first)} cannot be followed by {_named(second)}",
            code="DXB-A201",
            facts={"inner frames": f"`{first.child}` and `{second.parent}`"},
        )


def _shared_stamp(first: Pose | Similarity, second: Pose | Similarity) -> float | None:
    if first.stamp is not None and second.stamp is not None and first.stamp != second.stamp:
        raise ArtifactError(
            f"{_named(first)} and {_named(second)} hold at different times",
            code="DXB-A205",
            facts={"stamps [s]": f"{first.stamp} and {second.stamp}"},
            hint="interpolate one of them first",
        )
    return second.stamp if first.stamp is None else first.stamp


def _composed(first: Pose | Similarity, second: Pose | Similarity, size: int, scale: float = 1.0) -> np.ndarray | None:
    if first.covariance is None and second.covariance is None:
        return None
    both = [np.zeros((size, size)) if each.covariance is None else each.covariance for each in (first, second)]
    return uncertainty.compose(first.matrix, second.matrix, (both[0], both[1]), scale)
