"""Whether a camera shows what a policy learned to see: its field of view, and its place."""

from __future__ import annotations

import math

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.policy import ViewSpec
from dextera_build.geometry import quaternions, transforms

FIELD_RAD = math.radians(1.0)
"""Most that the rays of the corners of a frame may differ, more than calibrations of one lens do [rad]."""
PLACE_M, TURN_RAD = 0.01, math.radians(1.0)
"""What is always accepted between two poses of a camera [m], [rad]: calibrations seldom state a smaller error."""
SIGMAS = 3.0
"""Standard deviations within which two calibrations of one pose agree."""


def differences(policy: ViewSpec, here: ViewSpec, visual: float) -> dict[str, str]:
    """What differs between the camera of a policy's data and one of the same size: name -> both sides.

    Args:
        policy: The camera that filmed the policy's data, at the pose of which its calibration errs.
        here: The camera that the policy would see through.
        visual: Fraction of the errors of its calibration over which the films were spread, `Reset.visual`.
    """
    found = {}
    apart = _between_rays(policy, here)
    if apart > FIELD_RAD:
        found["with another field of view"] = (
            f"the policy has {_field(policy)}, the bundle has {_field(here)}; "
            f"corners are {math.degrees(apart):.1f} deg apart, {math.degrees(FIELD_RAD):g} deg are accepted"
        )
    away, turned = _between_poses(policy, here)
    spread = math.hypot(1.0, visual)
    most_m = PLACE_M + SIGMAS * math.hypot(spread * policy.sigma_m, here.sigma_m)
    most_rad = TURN_RAD + SIGMAS * math.hypot(spread * policy.sigma_rad, here.sigma_rad)
    if away > most_m or turned > most_rad:
        found["at another place"] = (
            f"{away:.3f} m and {math.degrees(turned):.1f} deg from the camera of the policy's data; "
            f"{most_m:.3f} m and {math.degrees(most_rad):.1f} deg are accepted for its calibration"
        )
    return found


def _field(view: ViewSpec) -> str:
    wide, high = (math.degrees(2 * math.atan2(s / 2, f)) for s, f in zip(view.size_px, view.focal_px, strict=True))
    return f"{wide:.1f} x {high:.1f} deg"


def _between_rays(one: ViewSpec, other: ViewSpec) -> float:
    """The largest angle between the rays of the same corner [rad]."""
    first, second = _corners(one), _corners(other)
    across = np.linalg.norm(np.cross(first, second), axis=1)
    return float(np.arctan2(across, (first * second).sum(axis=1)).max())


def _corners(view: ViewSpec) -> np.ndarray:
    (width, height), (fx, fy), (cx, cy) = view.size_px, view.focal_px, view.centre_px
    lens = Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)
    return lens.unproject(np.array([[x - 0.5, y - 0.5] for x in (0, width) for y in (0, height)]))


def _between_poses(one: ViewSpec, other: ViewSpec) -> tuple[float, float]:
    """Distance [m] and angle [rad]."""
    turns = [quaternions.to_matrix(np.array(view.quaternion)) for view in (one, other)]
    away = float(np.linalg.norm(np.subtract(one.position_m, other.position_m)))
    return away, float(transforms.angle(turns[0].T @ turns[1]))
