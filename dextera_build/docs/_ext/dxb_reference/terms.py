"""The tables of observation terms and of kinds of actions."""

from __future__ import annotations

from dextera_build.policy.actions import ABOUT, PALM
from dextera_build.policy.declared import DECLARED

from .markdown import table

_ROWS = {
    "joints": "A joints of the robot",
    "objects": "O objects",
    "displacement": "K joints of objects",
    "goal": "G numbers",
    "tips": "F fingertips",
    "limbs": "L limbs",
    "points": "P points",
}


def actions_page() -> str:
    """Every kind of action with the meaning, units and names of its numbers."""
    names = {
        "joint": "`joint_1`, ...",
        "delta": "`joint_1.delta`, ...",
        "end_effector": ", ".join(f"`{part}`" for part in PALM) + " of every palm, `joint_8`, ...",
    }
    rows = [[f"`{kind}`", about, unit, names[kind]] for kind, (about, unit) in ABOUT.items()]
    return table(["kind", "numbers", "unit", "names"], rows)


def page() -> str:
    """Every term with its group, shape, unit, frame, reader, feature and topic."""
    head = ["group", "term", "meaning", "rows", "unit", "frame", "seen by", "LeRobot feature", "ROS 2 topic"]
    rows = []
    for term in DECLARED:
        size = f" x {len(term.parts)}" if term.parts else ""
        where = "one per camera" if term.rows == "cameras" else f"{_ROWS[term.rows]}{size}"
        feature, topic = (text.replace("{}", "*") for text in (term.feature, term.topic))
        marked = [f"`{text}`" if text else "" for text in (feature, topic)]
        rows.append([term.group, f"`{term.name}`", term.about, where, term.unit, term.frame, term.seen_by, *marked])
    return table(head, rows)
