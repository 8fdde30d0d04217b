"""Arms and hands in the tree of a robot's links: where a chain branches into fingers, or ends in a jaw or a tool."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

FEWEST = 5
"""Minimum number of joints of an arm's chain; fingers have up to four."""
_FINGER = re.compile(r"finger|fngr|thumb|index|pinky|knuckle", re.IGNORECASE)
_JAW = re.compile(r"grip|jaw|claw|finger|fngr|pinch", re.IGNORECASE)
_LEG = re.compile(r"(^|_)([ul]?leg|hip|thigh|shank|knee|calf|ankle|foot)(_|\d|$)", re.IGNORECASE)


@dataclass
class Branch:
    """An arm with what is at its end; links are elements of the `mujoco.MjSpec`."""

    top: Any
    """First link."""
    palm: Any
    """Link that carries the fingers or the jaw; of an arm without a hand, its last link."""
    fingers: list[Any] = field(default_factory=list)
    """First links of the fingers; one is a jaw that closes against the palm's link; none: a tool."""
    others: list[Any] = field(default_factory=list)
    """First links of what is on the way and is no part of the arm: wheels, a head."""


def branches_of(top: Any) -> list[Branch]:
    """The arms below a link, without legs, or one of a hand alone; none if the robot has legs alone."""
    if moving(top) and all(map(_is_leg, moving(top))):
        return []
    found = list(_walk(top, top, 0, []))
    return [each for each in found if joints_between(top, each.palm) >= FEWEST] or found[:1]


def _is_leg(body: Any) -> bool:
    """Whether a link is named as part of a leg, or all moving links below it are, or the fixed body at its end."""
    inner = moving(body)
    if not inner:
        return any(_LEG.search(each.name) for each in subtree(body))
    return bool(_LEG.search(body.name)) or all(map(_is_leg, inner))


def _walk(top: Any, body: Any, above: int, others: list[Any]) -> Iterator[Branch]:
    while True:
        above += len(list(body.joints))
        inner = [each for each in moving(body) if not _is_leg(each)]
        others = [*others, *(each for each in moving(body) if each not in inner)]
        if not inner:
            yield _ended(top, body, above, others)
            return
        if len(inner) > 1:
            deep = [each for each in inner if depth(each) >= FEWEST]
            if above >= FEWEST or not deep or any(_FINGER.search(each.name) for each in inner):
                yield Branch(top, body, _fingers(body), others)
                return
            others = [*others, *(each for each in inner if each not in deep)]
            if len(deep) > 1:
                for each in deep:
                    yield from _walk(each, each, above, others)
                return
            inner = deep
        body = inner[0]


def _ended(top: Any, body: Any, above: int, others: list[Any]) -> Branch:
    """A chain that does not branch: its last link is a jaw if its name or its joint's says so, or it alone moves."""
    joints = list(body.joints)
    names = [body.name, *(joint.name for joint in joints)]
    if joints and body is not top and (above == 1 or any(map(_JAW.search, names))):
        return Branch(top, body.parent, [body], others)
    return Branch(top, last(body), [], others)


def _fingers(palm: Any) -> list[Any]:
    """Fingers of a hand: the chains that are at least half as long as the longest; shorter ones are parts of it."""
    found = starts(palm)
    most = max(map(depth, found))
    return [each for each in found if 2 * depth(each) >= most]


def starts(body: Any) -> list[Any]:
    """Descendants that begin a chain with joints, with fixed bodies in between skipped."""
    found = []
    for each in moving(body):
        if list(each.joints):
            found.append(each)
        else:
            inner = starts(each)
            found += [each] if len(inner) == 1 else inner
    return found


def moving(body: Any) -> list[Any]:
    """Children with a joint, or with one below."""
    return [each for each in body.bodies if depth(each)]


def depth(body: Any) -> int:
    """Largest number of joints on a way from a body to an end, its own included."""
    return len(list(body.joints)) + max(map(depth, body.bodies), default=0)


def subtree(body: Any) -> list[Any]:
    """A body and all its descendants."""
    found = [body]
    for each in found:
        found += list(each.bodies)
    return found


def way(top: Any, body: Any) -> list[Any]:
    """Links from `top` down to `body`, both included."""
    found = [body]
    while found[-1].name != top.name and found[-1].parent is not None and found[-1].parent.name != "world":
        found.append(found[-1].parent)
    return found[::-1]


def joints_between(top: Any, body: Any) -> int:
    """Number of joints from `top` to `body`, both included."""
    return sum(len(list(each.joints)) for each in way(top, body))


def last(body: Any) -> Any:
    """The last body of a chain, including a fixed body at its end."""
    while True:
        inner = sorted(body.bodies, key=depth, reverse=True)
        if not inner:
            return body
        body = inner[0]
