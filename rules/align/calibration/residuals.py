"""How well a solved calibration closes the chain of robot, camera and board."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.geometry import hand_eye_checks, hand_eye_refine
from dextera_build.geometry.hand_eye import Setup
from dextera_build.geometry.hand_eye_checks import Checked

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions


def residual(found: Checked, setup: Setup) -> tuple[float, float]:
    """Root mean square of the chain's residuals over the views: translation [m], rotation [rad]."""
    each = np.array([hand_eye_refine.closing(view, setup, found.refined.solution) for view in found.views])
    return tuple(np.sqrt((each**2).mean(axis=0)).tolist())


def fits(found: Checked, setup: Setup, common: HandEyeOptions) -> bool:
    """Whether poses and pictures agree.

    Two distant markers place a board no better than to a decimetre: if the other pictures predict the corners of each
    picture, its large residual is no contradiction.
    """
    distance, angle = residual(found, setup)
    small = distance <= common.most_residual_m and np.degrees(angle) <= common.most_residual_deg
    return bool(small or (found.left and max(one.off_px for one in found.left) < hand_eye_checks.NOTABLE_PX))
