"""Primitive `lift`: an object is held by the hand alone, above its initial height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.task import TaskSpec
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH, near
from dextera_build.sim.primitives.state import GraspState, TaskState

SLIP_M_S = 0.05
"""Maximum speed of a held object relative to the palm [m/s]; the same in every world."""


def succeeded(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Whether the object's origin rose by `height_m` and only a valid grasp holds it now.

    A valid grasp has at least two opposing fingers, no other support and no slip. A throw fails because no fingers
    press, pinning against the table because of the height and the support.
    """
    rise = float(now.world_from_object[2, 3] - start.world_from_object[2, 3])
    grasp = now.grasp
    held = grasp.fingers >= 2 and grasp.opposing and not grasp.supported and grasp.slip_m_s < SLIP_M_S
    return rise >= task.height_m and held


@dataclass(frozen=True)
class Progress:
    """Progress of lifting."""

    reach_m: float
    """Mean distance of the fingertips from the object's surface [m]."""
    grasp: GraspState
    """Grasp state of the object."""
    rise: float
    """Rise of the object, as a fraction of the required height."""
    success: bool
    """Whether the task is done."""


def value(progress: Progress) -> float:
    """Value of a state: reach, then hold with opposing forces, then rise, then success."""
    grasp = progress.grasp
    hold = 0.5 * min(grasp.fingers, 2) / 2 + 0.5 * float(grasp.opposing)
    held = grasp.fingers >= 2 and grasp.opposing
    rise = float(np.clip(progress.rise, 0.0, 1.0)) if held else 0.0
    return REACH * near(progress.reach_m) + HOLD * hold + MOVE * rise + DONE * float(progress.success)
