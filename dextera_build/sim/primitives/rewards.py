"""Staged rewards of the task primitives: pure functions of how far an episode has come.

A stage function gives the value of one moment. A learner is paid the change of that value from step to step, so what
an episode earns is fixed by where it ends: there is nothing to gain by hovering before the goal, by going back and
forth, or by letting an object fly, because a stage counts only while the one before it holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.sim.primitives.success import GraspState

NEAR_M = 0.2
"""Distance that costs as much as the stage of reaching is worth [m]; even, so that it draws from far away too."""
FAR_M = 0.8
"""Distance beyond which nothing changes [m]."""
REACH, HOLD, MOVE, DONE = 1.0, 1.0, 4.0, 5.0
"""Rewards of the stages: at the object, in the hand, moved to the goal, held there until it counts."""
DRAG = 0.4
"""Cost of dragging an object by the allowed distance; small, because slippery objects move a little."""


@dataclass(frozen=True)
class LiftProgress:
    """How far lifting has come."""

    reach_m: float
    """Mean distance of the fingertips from the object's surface [m]."""
    grasp: GraspState
    """The hold on the object."""
    rise: float
    """Rise of the object as a share of the height that is asked for."""
    success: bool
    """The task is done."""


@dataclass(frozen=True)
class ArticulateProgress:
    """How far moving joints has come."""

    reach_m: float
    """Distance of the nearest fingertip from where it has to push [m]."""
    left: float
    """Distance of the joints from their commands as a share of its value at the start."""
    strayed: float
    """How far the object was dragged as a share of the allowance."""
    success: bool
    """The task is done."""


def lift(progress: LiftProgress) -> float:
    """Value of a moment: reach, then hold with forces that oppose one another, then rise, then success."""
    grasp = progress.grasp
    hold = 0.5 * min(grasp.fingers, 2) / 2 + 0.5 * float(grasp.opposing)
    held = grasp.fingers >= 2 and grasp.opposing
    rise = float(np.clip(progress.rise, 0.0, 1.0)) if held else 0.0
    return REACH * near(progress.reach_m) + HOLD * hold + MOVE * rise + DONE * float(progress.success)


def articulate(progress: ArticulateProgress) -> float:
    """Value of a moment: reach, then bring the joints to their commands, then success.

    The hand counts for less the nearer the joints are, so that it may release a joint that has arrived. An object that
    is dragged along takes away from all.
    """
    moved = 1.0 - float(np.clip(progress.left, 0.0, 2.0))
    reach = 1.0 - (1.0 - near(progress.reach_m)) * min(1.0, progress.left)
    return REACH * reach - DRAG * min(2.0, progress.strayed) + MOVE * moved + DONE * float(progress.success)


def near(distance_m: float) -> float:
    """1 at no distance, 0 at `NEAR_M`, and less up to `FAR_M`.

    It ends there, because one object that is knocked far off the table would outweigh a hundred episodes.
    """
    return 1.0 - min(max(0.0, distance_m), FAR_M) / NEAR_M
