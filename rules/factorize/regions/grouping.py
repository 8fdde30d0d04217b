"""Group patches into objects by how their surfaces meet, always judged for whole groups.

Objects are mostly convex from outside. Patches that meet convexly or smoothly are joined; concave creases and depth
steps separate them, with six exceptions: slivers, cavities, attached parts, groups that a network classifies as one
object, one surface visible on both sides of an occluder, and laptops. Cavities and parts are not joined if the network
classifies them as two objects with high confidence. Groups whose whole parts it classifies as two objects are divided.
Patches that go on above and below a ledge are divided first, and are never joined again.
"""

from __future__ import annotations

import numpy as np

from . import ledges, relations
from .partition import FEWEST, Grouping
from .patches import Surfaces
from .revision import divide_doubted

SLIVER_M2 = 0.0006
"""Patches below this size are remnants of creases and noise [m^2]."""
PART_M2 = 0.0025
"""Maximum size of attached parts such as handles [m^2]."""
ALIKE = 0.3
"""Smallest histogram overlap of one surface on both sides of an occluder, a depth step or a sharp crease."""
BONDED = 0.5
"""Log odds above which a pair that meets along a gentle crease is one object."""
BONDED_APART = 1.0
"""The same across a sharp crease or a depth step, if one part is minor or both have the same colours."""
BONDED_EQUALS = 1.5
"""The same for parts of similar size, where a wrong join loses both objects."""
MINOR = 0.3
"""A part with less than this fraction of the other's surface is minor."""
DOUBTED_CONVEX = -1.5
"""Log odds below which two groups that meet convexly are not joined."""
DOUBTED = -2.5
"""The same for a cavity and its body."""
DOUBTED_PART = -2.0
"""The same for an attached part and its body, for which only colours and a small gap are evidence."""
DOUBTED_HIDDEN = -1.0
"""The same for groups that touch beside an occluder."""
ATTACHED_M = 0.02
"""Widest gap between parts of one object [m]."""
LOST_M = 0.05
"""Widest gap without depth between parts of one object [m]."""


def group(s: Surfaces, labels: np.ndarray) -> Grouping:
    """Group a patch image into objects, one group each."""
    parts = Grouping(s, *ledges.divided(s, labels))
    join_convex(parts)
    join_slivers(parts)
    join_cavities(parts)
    join_convex(parts)
    join_parts(parts)
    join_bonded(parts)
    join_occluded(parts)
    join_lost(parts)
    join_hinged(parts)
    divide_doubted(parts)
    join_bonded(parts)
    return parts


def join_convex(parts: Grouping) -> None:
    """Join groups that meet convexly along most of their border, longest border first, unless the network doubts it."""
    doubted: set[tuple[int, int]] = set()
    while True:
        best, strength = None, 0.0
        for (a, b), contact in sorted(parts.contacts.items()):
            if (a, b) in doubted or min(parts.groups[a].area_m2, parts.groups[b].area_m2) < SLIVER_M2:
                continue
            if contact.pairs >= FEWEST and contact.convexity > 0.55 and contact.convex > strength:
                best, strength = (a, b), float(contact.convex)
        if best is None:
            return
        if parts.odds(*best) < DOUBTED_CONVEX:
            doubted.add(best)
            continue
        parts.join(*best)
        doubted = {pair for pair in doubted if not {*pair} & {*best}}


def join_slivers(parts: Grouping) -> None:
    """Assign slivers at creases and borders to the neighbour with the longest common border."""
    for number in sorted(parts.groups, key=lambda n: (parts.groups[n].area_m2, n)):
        if number not in parts.groups or parts.groups[number].area_m2 >= SLIVER_M2:
            continue
        options = [(parts.contact(number, n), n) for n in parts.neighbours(number)]
        options = [(c, n) for c, n in options if c.meeting >= 0.3 * c.pairs and c.pairs >= FEWEST]
        if options:
            parts.join(number, max(options, key=lambda o: (o[0].convex + 0.3 * o[0].meeting, -o[1]))[1])


def join_cavities(parts: Grouping) -> None:
    """Assign inner surfaces, seen over a rim, to the body with a rim of that height."""
    for number in sorted(parts.groups, key=lambda n: (parts.groups[n].area_m2, n)):
        while number in parts.groups and _is_cavity(parts, number):
            cavity = parts.groups[number]
            body = _body_of(parts, number)
            if body is None:
                break
            # Parts of the inner surface that join first leave the body still to be found.
            whole = not _is_cavity(parts, body) and parts.groups[body].area_m2 > 0.2 * cavity.area_m2
            number = parts.join(number, body)
            if whole:
                break


def _is_cavity(parts: Grouping, number: int) -> bool:
    return relations.is_cavity(parts.surfaces, parts.groups[number])


def _body_of(parts: Grouping, number: int) -> int | None:
    cavity = parts.groups[number]
    options = []
    for other in parts.neighbours(number):
        contact, body = parts.contact(number, other), parts.groups[other]
        same_rim = abs(cavity.top_m - body.top_m) < 0.015
        rim = contact.pairs >= FEWEST and (same_rim or _is_cavity(parts, other))
        if rim and parts.odds(number, other) > DOUBTED:
            options.append((contact.pairs, -other))
    return -max(options)[1] if options else None


def join_parts(parts: Grouping) -> None:
    """Assign handles and other small parts of similar colour to the larger body that they nearly touch."""
    for number in sorted(parts.groups, key=lambda n: (parts.groups[n].area_m2, n)):
        if number not in parts.groups or parts.groups[number].area_m2 >= PART_M2:
            continue
        part = parts.groups[number]
        options = []
        for other, body in sorted(parts.groups.items()):
            like = float(np.linalg.norm((part.colour - body.colour) * [0.5, 1.0, 1.0])) < 18.0
            if other != number and like and body.area_m2 > 2.0 * part.area_m2:
                distance = relations.gap(parts.surfaces, part, body)
                if distance < ATTACHED_M and parts.odds(number, other) > DOUBTED_PART:
                    options.append((-distance, -other))
        if options:
            parts.join(number, -max(options)[1])


def join_bonded(parts: Grouping) -> None:
    """Join groups that the network classifies as one object, the likeliest pair first, and score again."""
    scores: dict[tuple[int, int], float] = {}
    while True:
        for (a, b), contact in parts.contacts.items():
            if (a, b) not in scores:
                scores[a, b] = _bond(parts, a, b) if contact.pairs >= FEWEST else -np.inf
        best = max(scores, key=lambda pair: (scores[pair], pair), default=None)
        if best is None or scores[best] <= 0:
            return
        laptop = _is_hinged(parts, *best)
        kept = parts.join(*best)
        parts.hinged |= {kept} if laptop else set()
        scores = {pair: score for pair, score in scores.items() if not {*pair} & {*best}}


def _bond(parts: Grouping, a: int, b: int) -> float:
    """Log odds above the threshold for joining two groups; across steps and sharp creases, colours must be alike."""
    if parts.bonds.gentle(parts.contact(a, b)):
        return parts.odds(a, b) - BONDED
    one, other = parts.groups[a], parts.groups[b]
    alike = relations.likeness(parts.surfaces, one, other)
    minor = min(one.area_m2, other.area_m2) < MINOR * max(one.area_m2, other.area_m2)
    least = BONDED_APART if minor or alike > relations.SAME_COLOUR else BONDED_EQUALS
    return parts.odds(a, b) - least if alike > ALIKE else -np.inf


def join_occluded(parts: Grouping) -> None:
    """Join groups that show one flat surface on both sides of an occluder."""
    numbers = sorted(parts.groups)
    for a in numbers:
        for b in numbers:
            if a < b and a in parts.groups and b in parts.groups and _continues(parts, a, b):
                parts.join(a, b)


def join_lost(parts: Grouping) -> None:
    """Join groups of the same colours with a hole in the depth between them, as black and shining surfaces have."""
    for a in sorted(parts.groups):
        for b in sorted(parts.groups):
            if a < b and a in parts.groups and b in parts.groups and _interrupted(parts, a, b):
                parts.join(a, b)


def _interrupted(parts: Grouping, a: int, b: int) -> bool:
    s, p, q = parts.surfaces, parts.groups[a], parts.groups[b]
    if parts.contact(a, b).pairs >= FEWEST or min(p.area_m2, q.area_m2) < SLIVER_M2:
        return False
    if relations.likeness(s, p, q) < ALIKE or relations.gap(s, *sorted((p, q), key=lambda g: g.area_m2)) > LOST_M:
        return False
    own = (parts.labels == a) | (parts.labels == b)
    return parts.odds(a, b) > BONDED_APART and relations.lost_between(s, p, q, own)


def join_hinged(parts: Grouping) -> None:
    """Join the base and the lid of a laptop, which meet in a concave crease."""
    for a, b in sorted(parts.contacts):
        if a in parts.groups and b in parts.groups and _is_hinged(parts, a, b):
            parts.hinged.add(parts.join(a, b))


def _is_hinged(parts: Grouping, a: int, b: int) -> bool:
    if parts.contact(a, b).meeting < FEWEST:
        return False
    first, second = parts.groups[a], parts.groups[b]
    return relations.hinged(parts.surfaces, first, second) or relations.hinged(parts.surfaces, second, first)


def _continues(parts: Grouping, a: int, b: int) -> bool:
    """Whether two groups share a plane and its colours behind an occluder, or two crossing planes.

    Different objects often have tops of equal height, but rarely a second common plane.
    """
    if parts.contact(a, b).pairs >= FEWEST and parts.odds(a, b) < DOUBTED_HIDDEN:
        return False
    shared: list[np.ndarray] = []
    own = (parts.labels == a) | (parts.labels == b)
    for i in parts.members[a]:
        for j in parts.members[b]:
            p, q = parts.patches[i], parts.patches[j]
            if min(p.area_m2, q.area_m2) < SLIVER_M2 or abs(float(p.plane[0] @ q.plane[0])) < 0.85:
                continue
            s = parts.surfaces
            if relations.one_plane(s, p, q) and relations.hidden_between(s, p, q, own):
                crossing = any(abs(float(normal @ p.plane[0])) < 0.7 for normal in shared)
                if crossing or relations.likeness(s, p, q) > ALIKE:
                    return True
                shared.append(p.plane[0])
    return False
