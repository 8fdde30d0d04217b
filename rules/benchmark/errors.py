"""Tables of errors: one row per quantity and object, in any unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import lie, transforms

COLUMNS = (
    Column(name="Subject"),
    Column(name="Quantity"),
    Column(name="Unit"),
    Column(name="Error", better="lower"),
    Column(name="In region"),
)
"""`In region`: whether the truth is inside the stated 95 % region; None if none was stated or defined."""

Row = tuple[str, str, str, float, bool | None]


def table(title: str, rows: Sequence[Row], notes: tuple[str, ...]) -> Table:
    """The rows as a table."""
    cells: tuple[tuple[Cell, ...], ...] = tuple(rows)
    return Table(title=title, columns=COLUMNS, rows=cells, notes=notes)


def off(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(6,) translation [m] and rotation vector [rad] from `truth` (4, 4) to `found` (4, 4), in the parent frame."""
    return lie.between(truth, found)


def inside(error: np.ndarray, covariance: np.ndarray | None) -> bool | None:
    """Whether an error (N,) is inside the 95 % region of a covariance (N, N); None without one."""
    from scipy.stats import chi2

    if covariance is None:
        return None
    return bool(error @ np.linalg.lstsq(covariance, error, rcond=None)[0] <= chi2.ppf(0.95, len(error)))


def place_and_turn(subject: str, name: str, error: np.ndarray, covariance: np.ndarray | None) -> list[Row]:
    """Rows of distance [mm] and angle [deg] of an error (6,); both regions are marginal ones."""
    parts = [None if covariance is None else covariance[a:b, a:b] for a, b in ((0, 3), (3, 6))]
    return [
        (subject, name, "mm", 1000 * float(np.linalg.norm(error[:3])), inside(error[:3], parts[0])),
        (subject, f"{name} angle", "deg", float(np.degrees(np.linalg.norm(error[3:]))), inside(error[3:], parts[1])),
    ]


def camera_base(stand: np.ndarray, camera_pose: np.ndarray) -> np.ndarray:
    """T_base_camera (4, 4), from T_reference_base and T_reference_camera."""
    return np.asarray(transforms.invert(stand) @ camera_pose)
