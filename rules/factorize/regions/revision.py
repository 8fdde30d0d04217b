"""Proposals to divide groups, judged for both whole parts.

Patches join while little of an object is known. Only when the groups are complete can a join be judged by what both of
its sides became: a cup that the first join connected with what leans on it is then a cup beside a box.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .partition import FEWEST, Grouping

PARTED = -1.2
"""Log odds below which two parts of a group are two objects."""
LEAST_M2 = 0.0015
"""Smallest part [m^2]."""


def divide_doubted(parts: Grouping) -> None:
    """Divide groups along former joins that the network doubts now that both sides are whole, the least likely first."""
    waiting = sorted(set(parts.groups) - parts.hinged)
    while waiting:
        number = waiting.pop()
        odds, some = min(_proposals(parts, number), key=lambda option: option[0], default=(np.inf, frozenset()))
        if odds < PARTED:
            waiting += parts.part(number, some)


def _proposals(parts: Grouping, number: int) -> Iterator[tuple[float, frozenset[int]]]:
    """Log odds that a side of a former join and the rest of its group are one object, and the patches of the side."""
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
        if contact.pairs >= FEWEST:
            yield parts.bonds.score(parts.union(side), parts.union(rest), contact), side
