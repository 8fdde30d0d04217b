"""Constants of retargeting that a recipe can change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Retargeting:
    """How motion of hands becomes motion of a robot.

    Distances of the operator's fingertips are [m] of the operator, before scaling; those of a pinch are DexPilot's
    (Handa et al. 2020), as dex-retargeting states them.
    """

    enter_m: float = 0.03
    """A finger begins to pinch when its tip is nearer to the thumb's than this [m]."""
    leave_m: float = 0.05
    """It ends to pinch when its tip is further from the thumb's than this [m]."""
    closed_m: float = 0.015
    """Distance of the operator's tips at which their skins meet, and below which those of the robot do [m]."""
    low_pass_hz: float = 5.0
    """Frequency at which the motion of the fingers is halved in power; 0: no filter [Hz]."""
    scale: float | None = None
    """Metre of the robot's hand per metre of the operator's; None: by the lengths of their fingers."""
    arm_scale: float = 1.0
    """Metre of a palm per metre of a wrist."""
    heading_rad: float | None = None
    """Angle about the z axis that turns the operator's axes to those of the robot's base [rad]; None: the operator's
    head looks along the base's x axis at the first message that has one, or 0 without a head."""
    jump_m: float = 0.06
    """Displacement of a wrist between two messages that is not followed [m]."""
    jump_rad: float = float(np.radians(25))
    """Rotation of a wrist between two messages that is not followed [rad]."""
    apart_m: float = 0.005
    """Distance that arms keep from the rest of the robot, and hands from arms; 0: none [m]."""
