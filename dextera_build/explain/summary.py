"""The differences of two runs in one sentence: what moved in the world, and how many nodes differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.artifacts.comparison.motion import Motion
    from dextera_build.explain.compare import Row

_WORLD = "T_world_"


def sentence(found: Mapping[str, Sequence[Row]], total: int | None = None) -> str:
    """`camera moved 18.9 mm, 1.0 deg; base stayed; 10 of 56 nodes differ`; empty if nothing differs.

    Args:
        found: Node -> its differences.
        total: Number of nodes that were compared; None: two results, not two runs.
    """
    rows = sum(map(len, found.values()))
    if not rows:
        return ""
    differ = count(rows, "difference") if total is None else f"{len(found)} of {count(total, 'node')} differ"
    return "; ".join([*(told for _, told in _moves(found)), differ])


def first_moved(found: Mapping[str, Sequence[Row]]) -> dict[str, Sequence[Row]]:
    """The same nodes, those with a pose that moved first."""
    return dict(sorted(found.items(), key=lambda item: not any(_motion(row) for row in item[1])))


def _moves(found: Mapping[str, Sequence[Row]]) -> list[tuple[str, str]]:
    """Thing -> its motion in the world; nodes that return poses count before poses inside of other values."""
    moved: dict[str, tuple[bool, str]] = {}
    for rows in found.values():
        for row in rows:
            motion = _motion(row)
            if motion is None or not motion.frames.startswith(_WORLD):
                continue
            thing, whole = motion.frames.removeprefix(_WORLD), row.name == "type"
            if whole or not moved.get(thing, (False, ""))[0]:
                moved[thing] = whole, _told(thing, motion)
    return [(thing, told) for thing, (_, told) in moved.items()]


def _told(thing: str, motion: Motion) -> str:
    intervals = (motion.distance_interval_m, motion.angle_interval_deg)
    if all(interval is not None and interval[0] == 0.0 for interval in intervals):
        return f"{thing} stayed"
    return f"{thing} moved {1000 * motion.distance_m:.1f} mm, {motion.angle_deg:.1f} deg"


def _motion(row: Row) -> Motion | None:
    return None if row.output is None else row.output.motion
