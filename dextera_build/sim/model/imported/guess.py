"""Roles of a robot's links, guessed from the kinematic tree and from names."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import mujoco

from dextera_build.sim.model.imported.source import Source

_FLANGES = re.compile(r"(^|_)(flange|tool0|ee_link|hand_mount|link_?ee|attachment)", re.IGNORECASE)
_FINGERS = {
    "thumb": r"thumb|(^|_)th(_|$)",
    "index": r"index|(^|_)(if|ff)(_|$)",
    "middle": r"middle|(^|_)mf(_|$)",
    "ring": r"ring|(^|_)rf(_|$)",
    "little": r"little|pinky|(^|_)lf(_|$)",
    "inner": r"inner",
    "outer": r"outer",
    "left": r"left",
    "right": r"right",
}
"""Finger -> names of its links."""
FEWEST = 5
"""Minimum number of joints of an arm's chain; fingers have up to four."""


@dataclass
class Guess:
    """Initial values for a recipe."""

    hand: list[str] = field(default_factory=list)
    """Links at which hands begin."""
    frames: dict[str, str] = field(default_factory=dict)
    """Role -> link."""
    gripper: tuple[str, float, float] | None = None
    """Sliding joint of both fingers of the only hand, and its positions open and closed [m]."""


def roles(source: Source, root: str) -> Guess:
    """Arms, hands, flanges and fingertips below a link, whose name in the model is `base`."""
    found = Guess()
    top = source.spec.body(root)
    arms = _branches(top) if _count(top) and len(_branches(top)) > 1 else [top]
    long = [arm for arm in arms if _chain(arm) >= FEWEST]
    if len(long) < 2:  # one arm, or a hand alone
        _arm(top, root, "", found)
        found.gripper = _gripper(top, source)
        return found
    for number, arm in enumerate(long):
        side = next((side for side in ("left", "right") if side in arm.name.lower()), str(number + 1))
        _arm(arm, root, f"{side}_", found)
    # Tasks for one hand ask for frames without a side.
    last = "right_" if any(role.startswith("right_") for role in found.frames) else f"{len(long)}_"
    found.frames |= {role.removeprefix(last): link for role, link in found.frames.items() if role.startswith(last)}
    return found


def _arm(top: Any, root: str, side: str, found: Guess) -> None:
    palm = _palm(top)
    if palm is None:
        last = _last(top)
        found.frames[f"{side}flange"] = _flange(top) or _named(last, root)
        return
    found.hand.append(_named(palm, root))
    found.frames[f"{side}palm"] = _named(palm, root)
    if palm.name != root and palm.parent is not None and palm.parent.name != "world":
        found.frames[f"{side}flange"] = _flange(top) or _named(palm.parent, root)
    for number, finger in enumerate(_branches(palm)):
        tip = _last(finger)
        # In `openarm_left_ee_outer_finger`, `left` is the arm.
        own = re.sub(side.rstrip("_"), "", tip.name, flags=re.IGNORECASE) if side else tip.name
        name = next((name for name, form in _FINGERS.items() if re.search(form, own, re.IGNORECASE)), "")
        role = f"{side}tip_{name or number + 1}"
        found.frames[role if role not in found.frames else f"{side}tip_{number + 1}"] = _named(tip, root)


def _gripper(top: Any, source: Source) -> tuple[str, float, float] | None:
    """The parallel gripper of a hand with two fingers of one sliding joint each, of which one follows the other.

    Open is the limit that is farther from 0, because grippers count from closed.
    """
    palm = _palm(top)
    fingers = [] if palm is None else _branches(palm)
    joints = [joint for finger in fingers for joint in finger.joints]
    slide = all(joint.type == mujoco.mjtJoint.mjJNT_SLIDE for joint in joints)
    if not slide or [*map(_count, fingers)] != [1, 1] or len(joints) != 2:
        return None
    for one, other in (joints, joints[::-1]):
        if source.mimics.get(other.name, ("",))[0] == one.name:
            closed, opened = sorted(map(float, one.range), key=abs)
            return str(one.name), opened, closed
    return None


def _named(body: Any, root: str) -> str:
    return "base" if body.name == root else str(body.name)


def _branches(body: Any) -> list[Any]:
    """Descendants that begin a chain with joints, with fixed bodies in between skipped."""
    found = []
    for each in body.bodies:
        if not _count(each):
            continue
        if list(each.joints):
            found.append(each)
        else:
            inner = _branches(each)
            found += [each] if len(inner) == 1 else inner
    return found


def _count(body: Any) -> int:
    """Number of joints of a body and all its descendants."""
    return len(list(body.joints)) + sum(_count(each) for each in body.bodies)


def _chain(body: Any) -> int:
    """Joints from a body to the next branch or the end."""
    count = 0
    while True:
        count += len(list(body.joints))
        inner = [each for each in body.bodies if _count(each)]
        if len(inner) != 1:
            return count
        body = inner[0]


def _palm(body: Any) -> Any | None:
    """The first body with two chains with joints; None if the chain does not branch."""
    while True:
        inner = [each for each in body.bodies if _count(each)]
        if len(inner) > 1:
            return body
        if not inner:
            return None
        body = inner[0]


def _last(body: Any) -> Any:
    """The last body of a chain, including a fixed body at its end."""
    while True:
        inner = sorted(body.bodies, key=_count, reverse=True)
        if not inner:
            return body
        body = inner[0]


def _flange(top: Any) -> str | None:
    """A link with the name of a flange."""
    waiting = [top]
    for body in waiting:
        if _FLANGES.search(body.name):
            return str(body.name)
        waiting += list(body.bodies)
    return None
