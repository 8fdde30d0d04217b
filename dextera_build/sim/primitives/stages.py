"""Values of the stages that rewards of all primitives share.

A reward is the value of one moment: a pure function of how far an episode has come. A learner is paid the change of
that value from step to step, so the sum over an episode is fixed by where it ends: nothing is gained by hovering before
the goal, by going back and forth, or by letting an object fly, because a stage counts only while the one before it
holds.
"""

from __future__ import annotations

NEAR_M = 0.2
"""Distance that costs as much as the stage of reaching is worth [m]; even, so that it draws from far away too."""
FAR_M = 0.8
"""Distance beyond which nothing changes [m]."""
REACH, HOLD, MOVE, DONE = 1.0, 1.0, 4.0, 5.0
"""Rewards of the stages: at the object, in the hand, moved to the goal, held there until it counts."""


def near(distance_m: float) -> float:
    """1 at no distance, 0 at `NEAR_M`, and less up to `FAR_M`.

    It ends there, because one object that is knocked far off the table would outweigh a hundred episodes.
    """
    return 1.0 - min(max(0.0, distance_m), FAR_M) / NEAR_M
