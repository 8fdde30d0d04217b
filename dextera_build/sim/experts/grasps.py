"""Candidate grasps from an object's shape and a hand's grips, without object-specific rules.

A grip `against: thumb` holds the object between the thumb and the other fingertips; a grip `against: palm` holds it in
the palm with the fingers closed around it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.artifacts.robots.robot import Grip
from dextera_build.geometry import transforms
from dextera_build.sim.control.hand import HandKinematics
from dextera_build.sim.experts.grasp import Grasp

UP = np.array([0.0, 0.0, 1.0])
SPARES_M = (0.03, 0.015)
"""Openings of the fingers beyond the object's width; straighter fingers reach lower [m]."""
SLAB_M = 0.03
"""Half height and half width of the slab in which the object's width is measured [m]."""
STILL_M = 0.001
"""Way between open and closed below which a finger does not move: that of a jaw against which the other closes [m]."""
ROOM_M = 0.045
"""Minimum gap between two walls for fingers [m]."""
RIMS_M = (0.012, 0.018, 0.028)
"""Depths below the top at which walls are pinched [m]."""
WALL_STRIP_M = 0.018
"""Half width of the strip across a vessel in which its walls are searched [m]."""
LOW_M = 0.012
"""Smallest height of fingertips at a wall [m]."""
RETREAT_M = 0.08
"""Distance from the grasp at which a hand waits for a top grasp [m]; for a side grasp it is shorter."""
AROUND = 12
"""Number of directions around the vertical."""


def candidates(points: np.ndarray, grips: dict[str, Grip], hand: HandKinematics) -> Iterator[Grasp]:
    """Generate grasps of an upright object.

    Args:
        points: (P, 3) on its surface, in its frame, z up [m].
        grips: The hand's grips.
        hand: The hand's kinematics.
    """
    for name, grip in grips.items():
        if grip.against == "thumb":
            yield from pinches(points, name, grip, hand)
        elif grip.against == "palm":
            yield from wraps(points, name, grip, hand)


def pinches(points: np.ndarray, name: str, grip: Grip, hand: HandKinematics) -> Iterator[Grasp]:
    """Generate grasps between thumb and fingertips, from above and from the side, of the whole object or of a wall."""
    opened, closed = hand.posture(grip.open), hand.posture({**grip.open, **grip.closed})
    pressing = hand.pressing(opened, closed)
    # By the whole way: near the end of it, a thumb that closes hardly moves either.
    jaw = any(map(_still, _tips(hand, opened, pressing), _tips(hand, closed, pressing)))
    travel = [_gap(hand, opened + part * (closed - opened), pressing) for part in np.linspace(0.0, 1.0, 21)]
    top, facing = float(points[:, 2].max()), np.array(grip.facing)
    middles = {top / 2, *(max(top - deep, top / 2) for deep in (0.015, 0.03, 0.045))}
    rims = {max(top - deep, LOW_M) for deep in RIMS_M}
    heights = sorted(middles | rims)
    for height, turn in itertools.product(heights, np.arange(2 * AROUND) * np.pi / AROUND):
        across = np.array([np.cos(turn), np.sin(turn), 0.0])
        whole = _held(points, height, across) if height in middles else None
        walls = _walls(points, height, across) if height in rims else []
        for kind, held in [("", whole), *((" wall", wall) for wall in walls)]:
            touch = None if held is None else _part(travel, held[1] + 2 * grip.tip_radius_m)
            if held is None or touch is None:
                continue
            thumb, fingers = _tips(hand, opened + touch * (closed - opened), pressing)
            # Thumb and fingers press along a horizontal line, because a tilted line consumes friction.
            for tilt, spare in itertools.product((0.0, 0.35, -0.35, 0.7, -0.7, 1.05, -1.05), SPARES_M):
                wide = _part(travel, held[1] + 2 * grip.tip_radius_m + spare) or 0.0
                down = np.cross(UP, across) * np.sin(tilt) - UP * np.cos(tilt)
                waiting = opened + wide * (closed - opened)
                before = _tips(hand, waiting, pressing)
                turns = {"": _align(fingers - thumb, facing, across, down)}
                if jaw:  # An arm of five joints turns its hand about the vertical, if the hand points straight down.
                    turns[" straight"] = _align(facing, fingers - thumb, down, across)
                for more, turned in turns.items():
                    yield Grasp(
                        palm=transforms.rigid(turned, held[0] - turned @ (thumb + fingers) / 2),
                        away=-RETREAT_M * down,
                        open=waiting,
                        closed=closed,
                        aside_m=_aside(turned, across, (thumb, fingers), before) if jaw else (0.0, 0.0, 0.0),
                        name=_label(name + kind + more, height, turn=turn, tilt=tilt)
                        + f", {1000 * spare:.0f} mm wider",
                        way=f"{name}{kind}{more} {np.degrees(turn) // 45:.0f}",
                        wall=held[0] if kind else None,
                        above_m=0.03,
                        aside=0.0,
                    )


def wraps(points: np.ndarray, name: str, grip: Grip, hand: HandKinematics) -> Iterator[Grasp]:
    """Generate grasps in the palm, from the side."""
    opened, closed = hand.posture(grip.open), hand.posture({**grip.open, **grip.closed})
    top, middle = float(points[:, 2].max()), (points.min(axis=0) + points.max(axis=0)) / 2
    heights = sorted({min(top * part, 0.12) for part in (0.4, 0.5, 0.65)})
    rolls = (0.0, 0.3, np.pi - 0.3, np.pi, np.pi + 0.3, -0.3)
    turns = np.arange(AROUND) * 2 * np.pi / AROUND
    for height, turn, dip, roll, forward in itertools.product(heights, turns, (0.0, 0.15), rolls, (0.025, 0.05)):
        out = np.array([np.cos(turn) * np.cos(dip), np.sin(turn) * np.cos(dip), -np.sin(dip)])
        side = np.array([-np.sin(turn), np.cos(turn), 0.0])
        along = side * np.cos(roll) + np.cross(out, side) * np.sin(roll)
        turned = _align(np.array(grip.facing), np.array(grip.pointing), out, along)
        place = _laid(points, np.array([*middle[:2], height]), out, along, forward)
        yield Grasp(
            palm=transforms.rigid(turned, place - out * grip.surface_m),
            away=-0.6 * RETREAT_M * out,
            open=opened,
            closed=closed,
            name=_label(name, height, turn=turn, dip=dip, roll=roll) + f", {1000 * forward:.0f} mm ahead",
            way=f"{name} {np.degrees(turn) // 45:.0f}",
            above_m=0.16,
            aside=1.2,
            arc_m=0.14,
        )


def _label(grip: str, height: float, **angles: float) -> str:
    stated = ", ".join(f"{name} {np.degrees(angle):.0f}" for name, angle in angles.items())
    return f"{grip} at {1000 * height:.0f} mm, {stated} deg"


def _laid(points: np.ndarray, middle: np.ndarray, out: np.ndarray, along: np.ndarray, forward: float) -> np.ndarray:
    """Position at which the palm, facing `out`, touches the object, which is `forward` of it [m]."""
    across = np.cross(out, along)
    origin = middle - forward * along
    local = points - origin
    under = (np.abs(local @ along - 0.02) < 0.07) & (np.abs(local @ across) < 0.055)
    near = float((local[under] @ out).min()) if under.any() else 0.0
    return np.asarray(origin + out * (near - 0.001))


def _held(points: np.ndarray, height: float, across: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centre (3,) and width [m] along `across` of the object at a height, near its vertical axis."""
    middle = np.median(points, axis=0)
    local = points - np.array([middle[0], middle[1], height])
    beside = np.cross(UP, across)
    held = (np.abs(local[:, 2]) < SLAB_M / 2) & (np.abs(local @ beside) < SLAB_M)
    if held.sum() < 4:
        return None
    low, high = float((local[held] @ across).min()), float((local[held] @ across).max())
    return np.array([middle[0], middle[1], height]) + across * (low + high) / 2, high - low


def _walls(points: np.ndarray, height: float, across: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Centres (3,) and widths [m] along `across` of the walls of a vessel at a height; none for other objects."""
    middle = np.median(points, axis=0)
    local = points - np.array([middle[0], middle[1], height])
    # Higher parts obstruct the hand, too.
    above = (local[:, 2] > -SLAB_M / 3) & (np.abs(local @ np.cross(UP, across)) < WALL_STRIP_M)
    along = np.sort(local[above] @ across)
    cuts = np.flatnonzero(np.diff(along) > ROOM_M)
    if not len(cuts) or len(along) < 6:
        return []
    runs = np.split(along, cuts + 1)
    base = np.array([middle[0], middle[1], height])
    return [(base + across * (run[0] + run[-1]) / 2, float(run[-1] - run[0])) for run in (runs[0], runs[-1])]


def _tips(hand: HandKinematics, posture: np.ndarray, pressing: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    assert hand.thumb is not None
    return hand.tip(hand.thumb, posture), hand.reach(posture, pressing)


def _aside(
    turn: np.ndarray, across: np.ndarray, touching: tuple[np.ndarray, ...], waiting: tuple[np.ndarray, ...]
) -> tuple[float, float, float]:
    """Offset of the palm with which fingers that wait are at equal distances of the object.

    Args:
        turn: Rotation (3, 3) of the palm.
        across: Direction (3,) in which the object is held.
        touching: Thumb and fingers (3,) in the palm's frame where they touch the object [m].
        waiting: The same before they close [m].
    """
    moved = turn @ (np.add(*touching) - np.add(*waiting)) / 2
    x, y, z = (across * (moved @ across)).tolist()
    return (x, y, z)


def _still(one: np.ndarray, other: np.ndarray) -> bool:
    return float(np.linalg.norm(one - other)) < STILL_M


def _gap(hand: HandKinematics, posture: np.ndarray, pressing: Sequence[str]) -> float:
    thumb, fingers = _tips(hand, posture, pressing)
    return float(np.linalg.norm(fingers - thumb))


def _part(travel: list[float], gap: float) -> float | None:
    """Closing fraction (0-1) at which the tips are `gap` apart [m]; None if the hand cannot open that wide."""
    if gap > travel[0]:
        return None
    return float(np.interp(-gap, -np.array(travel), np.linspace(0.0, 1.0, len(travel))))


def _align(first: np.ndarray, second: np.ndarray, to_first: np.ndarray, to_second: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that maps `first` to `to_first`, and `second` as close to `to_second` as possible."""
    return np.asarray(_frame(to_first, to_second) @ _frame(first, second).T)


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    x = first / np.linalg.norm(first)
    y = second - x * (x @ second)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)
