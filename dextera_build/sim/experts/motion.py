"""Hand motions as timed legs: minimum jerk, straight in position, shortest in rotation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.operator import Aim, Command


@dataclass(frozen=True)
class Leg:
    """A motion to a pose and a finger posture, ending at rest."""

    palm: np.ndarray
    """(4, 4) T_base_palm at the end."""
    fingers: np.ndarray
    """(H,) joint targets at the end [rad]."""
    seconds: float
    """Duration [s]."""
    segment: str
    """See `Command.segment`."""
    frame: str = ""
    """See `Command.frame`."""
    contact: bool = False
    """See `Command.contact`."""
    arc_m: float = 0.0
    """Height of the path's midpoint above the straight line, along z of the base [m]."""


Plan = Mapping[str, Sequence[Leg]]
"""Limb -> its legs. Legs with the same index have the same duration and segment."""
Hands = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Limb -> T_base_palm (4, 4) and finger joints (H,) [rad]."""


def follow(plan: Plan, hands: Hands, control_hz: float) -> Iterator[Command]:
    """Commands of all limbs of a plan at control rate, starting at their `hands`."""
    streams = [sample(limb, *hands[limb], legs, control_hz) for limb, legs in plan.items()]
    for parts in zip(*streams, strict=True):
        aims = {limb: aim for part in parts for limb, aim in part.aims.items()}
        own = {limb: part.part(limb) for part in parts for limb in part.aims}
        differ = own if len(set(own.values())) > 1 else {}
        yield replace(parts[0], aims=aims, contact=any(part.contact for part in parts), parts=differ)


def sample(
    limb: str, palm: np.ndarray, fingers: np.ndarray, legs: Sequence[Leg], control_hz: float
) -> Iterator[Command]:
    """Commands of a limb at control rate from a start (4, 4), (H,) through all legs."""
    for leg in legs:
        steps = max(1, round(leg.seconds * control_hz))
        for step in range(1, steps + 1):
            part = minimum_jerk(step / steps)
            pose = between(palm, leg.palm, part)
            pose[2, 3] += leg.arc_m * 16.0 * part**2 * (1.0 - part) ** 2
            yield Command(
                aims={limb: Aim(pose, fingers + part * (leg.fingers - fingers))},
                segment=leg.segment,
                frame=leg.frame,
                contact=leg.contact,
            )
        palm, fingers = leg.palm, leg.fingers


def minimum_jerk(part: float) -> float:
    """Progress 0-1 after fraction `part` 0-1 of the time: at rest at both ends, with minimum jerk."""
    return float(part**3 * (10.0 - 15.0 * part + 6.0 * part**2))


def between(first: np.ndarray, last: np.ndarray, part: float) -> np.ndarray:
    """Pose (4, 4) at fraction `part` 0-1 of the path: position along a line, rotation along the shortest arc."""
    turn = first[:3, :3].T @ last[:3, :3]
    place = first[:3, 3] + part * (last[:3, 3] - first[:3, 3])
    return transforms.rigid(first[:3, :3] @ lie.rotation(lie.rotation_vector(turn) * part), place)


def shifted(pose: np.ndarray, way: np.ndarray) -> np.ndarray:
    """A pose (4, 4) translated by `way` (3,) [m]."""
    moved = pose.copy()
    moved[:3, 3] += way
    return moved
