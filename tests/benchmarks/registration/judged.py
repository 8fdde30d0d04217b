"""How far a placement is off: at the object's centre, with its symmetries, and by the nearest surface (ADD-S)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from dextera_build.geometry import kinematics, metrics, symmetry, transforms
from dextera_build.geometry.raycast import RayScene
from dextera_build.geometry.registration import ScaledPose
from dextera_build.geometry.symmetry import Symmetry

from .scenes import Known


@dataclass(frozen=True)
class Truth:
    """What errors are measured against."""

    placed: ScaledPose
    symmetry: Symmetry  # of the asset
    points: np.ndarray  # (N, 3) on the asset's surface, its units


@dataclass(frozen=True)
class Error:
    """A placement against the truth."""

    move_m: float  # of the surface's centroid
    turn_deg: float  # over the symmetries
    scale: float  # log of found over true
    adds_m: float  # mean distance of true points to the nearest placed ones


def truth(known: Known) -> Truth:
    """Symmetry and samples of a view's object."""
    vertices, faces = kinematics.posed_surface(known.asset)
    return Truth(
        ScaledPose(known.scale, known.pose),
        symmetry.find(vertices, faces, RayScene((vertices, faces)).distances, samples=1000),
        metrics.sample_surface(vertices, faces, 40000, 0),
    )


def error(truth: Truth, found: ScaledPose) -> Error:
    """See `Error`."""
    true, placed = truth.placed.apply(truth.points[:1000]), found.apply(truth.points)
    centre = truth.symmetry.centre[None]
    return Error(
        move_m=float(np.linalg.norm(truth.placed.apply(centre) - found.apply(centre))),
        turn_deg=float(np.degrees(truth.symmetry.angle(truth.placed.pose[:3, :3], found.pose[:3, :3]))),
        scale=float(np.log(found.scale / truth.placed.scale)),
        adds_m=float(np.mean(KDTree(placed).query(true)[0])),
    )


def surprise(truth: Truth, found: ScaledPose, covariance: np.ndarray) -> float | None:
    """Squared error of position and rotation (6) over its stated covariance; None for round bodies and wrong turns.

    The truth is the nearest one over the finite symmetries.
    """
    if truth.symmetry.round_axis is not None:
        return None
    true, centre = truth.placed, truth.symmetry.centre
    turns = [transforms.rigid(turn, true.scale * (centre - turn @ centre)) for turn in truth.symmetry.turns()]
    poses = [true.pose @ turn for turn in turns]
    pose = min(poses, key=lambda one: transforms.angle(found.pose[:3, :3] @ one[:3, :3].T))
    turn = found.pose[:3, :3] @ pose[:3, :3].T
    if transforms.angle(turn) > np.radians(10.0):
        return None
    off = np.concatenate([found.pose[:3, 3] - pose[:3, 3], Rotation.from_matrix(turn).as_rotvec()])
    return float(off @ np.linalg.solve(covariance, off))
