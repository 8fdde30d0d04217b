"""Parts of a recording in which the forces on the arm are known: free motion, an object in the hand, a sliding one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms

MOVED_M = 0.008
"""Displacement of an object that is more than the noise of a tracker [m]."""
RAISED_M = 0.02
"""Height above its support at which an object is certainly carried [m]."""
SLIP_M = 0.03
"""Largest change of an object's place in a hand that carries it [m]; includes the tracker's delay."""
LEVEL_M = 0.01
"""Largest change of height of an object that slides [m]."""
SLIDING_M_S = 0.015
"""Least speed of an object that slides, and of the hand that pushes it [m/s]."""
SPAN_S = 0.2
"""Half the time over which the speed of an object is taken [s]."""
LATE_S = 0.2
"""Largest delay of a tracker [s]."""
SETTLE_S = 0.3
"""Time after a change of the load until the arm has settled [s]: three times the lag of a joint."""
REST = 5
"""Number of first rows in which the object is at rest."""
BEFORE_S = 0.5
"""Time before an object first moves in which a hand may already touch it [s]."""


@dataclass(frozen=True)
class Phases:
    """Parts of one recording, by control period (T,)."""

    free: np.ndarray
    """Whether no hand is near an object, bool."""
    limb: str = ""
    """The hand at the object; empty without contact."""
    loaded: np.ndarray | None = None
    """Whether the object hangs in the hand, bool; None if it was never carried."""
    carried: np.ndarray | None = None
    """Whether it hangs there long enough for the arm to have settled, bool."""
    held: np.ndarray | None = None
    """T_palm_object (4, 4)."""
    sliding: np.ndarray | None = None
    """Direction (T, 3) in the base in which the object slides, zeros where it does not; None if it never does."""
    pushed: np.ndarray | None = None
    """Whether it slides long enough for the arm to have settled, bool."""
    why: str = ""
    """Why the contact tells nothing, if so."""


def phases(
    palms: Mapping[str, np.ndarray], seen: np.ndarray, points: np.ndarray, up: np.ndarray, reach_m: float, hz: float
) -> Phases:
    """Divide a recording.

    Args:
        palms: Limb -> T_base_palm (T, 4, 4).
        seen: T_base_object (T, 4, 4) of the task's object.
        points: (P, 3) of its surface, in its frame [m].
        up: Vertical (3,) in the base.
        reach_m: Distance from a palm that its fingertips can reach [m].
        hz: Control rate [Hz].
    """
    away = {limb: distances(each, seen, points) for limb, each in palms.items()}
    nearest = np.min(list(away.values()), axis=0)
    place = _smooth(seen[:, :3, 3])
    place = place - np.median(place[:REST], axis=0)
    moved = np.linalg.norm(place, axis=1) > MOVED_M
    begins = int(np.argmax(moved)) if moved.any() else len(moved)
    rows = np.arange(len(moved))
    free = (np.minimum.accumulate(nearest) > reach_m) & (rows < begins - BEFORE_S * hz)
    height = place @ up
    raised = height > RAISED_M
    if raised.sum() >= SETTLE_S * hz:
        return _carried(palms, away, seen, free, height, raised, reach_m, hz)
    if moved.any():
        return _pushed(palms, away, place, up, free, height, hz)
    return Phases(free, why="the object was never moved")


def distances(palm: np.ndarray, seen: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (T,) of each T_base_palm (T, 4, 4) from the points of an object at T_base_object (T, 4, 4) [m]."""
    surface = points @ seen[:, :3, :3].transpose(0, 2, 1) + seen[:, None, :3, 3]
    return np.asarray(np.linalg.norm(surface - palm[:, None, :3, 3], axis=2).min(axis=1))


def _carried(
    palms: Mapping[str, np.ndarray],
    away: Mapping[str, np.ndarray],
    seen: np.ndarray,
    free: np.ndarray,
    height: np.ndarray,
    raised: np.ndarray,
    reach_m: float,
    hz: float,
) -> Phases:
    near = {limb: float(np.median(each[raised])) for limb, each in away.items()}
    limb = min(near, key=lambda name: near[name])
    if sum(each < reach_m for each in near.values()) > 1:
        return Phases(free, limb, why="two hands carried the object, and what they press on one another is not known")
    inside = np.array([transforms.invert(palm) @ thing for palm, thing in zip(palms[limb], seen, strict=True)])
    speed = np.linalg.norm(np.gradient(palms[limb][:, :3, 3], 1.0 / hz, axis=0), axis=1)
    # A tracker is late, so that the object seems to lag behind a moving hand.
    weight = raised / (0.02 + speed)
    held = inside[int(np.argmax(weight))].copy()
    held[:3, 3] = (weight[:, None] * inside[:, :3, 3]).sum(axis=0) / weight.sum()
    kept = np.linalg.norm(inside[:, :3, 3] - held[:3, 3], axis=1) < SLIP_M
    first = int(np.argmax(height > MOVED_M))
    last = int(np.flatnonzero(raised)[-1])
    rows = np.arange(len(raised))
    loaded = (rows >= first) & (rows <= last)
    carried = raised & kept & (away[limb] < reach_m) & (rows >= first + SETTLE_S * hz)
    if not carried.any():
        return Phases(free, limb, why="the object did not stay in the hand that raised it")
    return Phases(free, limb, loaded=loaded, carried=carried, held=held)


def _pushed(
    palms: Mapping[str, np.ndarray],
    away: Mapping[str, np.ndarray],
    place: np.ndarray,
    up: np.ndarray,
    free: np.ndarray,
    height: np.ndarray,
    hz: float,
) -> Phases:
    limb = min(away, key=lambda name: float(away[name].min()))
    motion = _along(place, up, SPAN_S, hz)
    speed = np.linalg.norm(motion, axis=1)
    moving = np.linalg.norm(_along(palms[limb][:, :3, 3], up, 1.0 / hz, hz), axis=1) > SLIDING_M_S
    slides = moving & (speed > SLIDING_M_S) & (np.abs(height) < LEVEL_M)
    since = np.zeros(len(slides), int)
    for row in range(1, len(slides)):
        since[row] = since[row - 1] + 1 if slides[row] else 0
    # A tracker is late: what it shows now was some time ago, so that the object must still be seen to slide later.
    late = round(LATE_S * hz)
    pushed = (since >= SETTLE_S * hz) & np.append(since[late:] > late, np.zeros(late, bool))
    if not pushed.any():
        return Phases(free, limb, why=f"the object never slid for more than {SETTLE_S + LATE_S:g} s")
    direction = np.where(slides[:, None], motion / np.maximum(speed, 1e-9)[:, None], 0.0)
    return Phases(free, limb, sliding=direction, pushed=pushed)


def _along(place: np.ndarray, up: np.ndarray, span_s: float, hz: float) -> np.ndarray:
    """Horizontal velocity (T, 3) of places [m], over `span_s` before and after."""
    half, rows = max(1, round(span_s * hz)), np.arange(len(place))
    ahead, behind = np.minimum(rows + half, len(place) - 1), np.maximum(rows - half, 0)
    motion = (place[ahead] - place[behind]) * (hz / (ahead - behind))[:, None]
    return np.asarray(motion - (motion @ up)[:, None] * up)


def _smooth(places: np.ndarray) -> np.ndarray:
    """Running median (T, 3) of five."""
    padded = np.concatenate([places[:1], places[:1], places, places[-1:], places[-1:]])
    return np.asarray(np.median([padded[first : len(places) + first] for first in range(5)], axis=0))
