"""Proposals to divide groups, judged for both whole parts.

Patches join while little of an object is known. Only when the groups are complete can a join be judged by what both of
its sides became: a cup and what leans on it look unlike one object, even if some of their patches do not.
"""

from __future__ import annotations

from collections.abc import Iterator

from . import relations
from .partition import FEWEST, Grouping

PARTED = -1.2
"""Log odds below which two parts of a group are two objects."""
PARTED_CAVITY = -2.5
"""The same if one of them is concave: the inside of a vessel looks unlike its outside."""
LEAST_M2 = 0.0015
"""Smallest part [m^2]."""


def divide_doubted(parts: Grouping) -> None:
    """Divide groups along former joins that the network doubts when it sees both sides, the least likely first.

    Parts of the same colours are not divided: nothing but the geometry of their contact speaks for two objects.
    """
    waiting = sorted(set(parts.groups) - parts.hinged)
    while waiting:
        number = waiting.pop()
        doubt, some = max(_proposals(parts, number), key=lambda option: option[0], default=(0.0, frozenset[int]()))
        if doubt > 0.0:
            waiting += parts.part(number, some)


def _proposals(parts: Grouping, number: int) -> Iterator[tuple[float, frozenset[int]]]:
    """How far the odds that a side of a former join and the rest are one object fall below the limit, and the side."""
    whole = frozenset(parts.members[number])
    if parts.groups[number].area_m2 < 2.0 * LEAST_M2:
        return
    known = set[frozenset[int]]()
    for side in (side for pair in parts.joins for side in pair):
        rest = whole - side
        if not side < whole or side in known or rest in known:
            continue
        known.add(side)
        area = sum(parts.patches[patch].area_m2 for patch in side)
        if not LEAST_M2 <= area <= parts.groups[number].area_m2 - LEAST_M2:
            continue
        contact = parts.contact_of(side, rest)
        ends = parts.union(side), parts.union(rest)
        if contact.pairs >= FEWEST and relations.likeness(parts.surfaces, *ends) < relations.SAME_COLOUR:
            hollow = any(relations.is_cavity(parts.surfaces, end) for end in ends)
            yield (PARTED_CAVITY if hollow else PARTED) - parts.bonds.score(*ends, contact), side
