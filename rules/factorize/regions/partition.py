"""A partition of patches into groups, which can be joined."""

from __future__ import annotations

import numpy as np

from . import relations
from .bonds import Bonds
from .patches import Surfaces
from .relations import Contact, Group

FEWEST = 12
"""Contacts with fewer pixel pairs are ignored."""


class Grouping:
    """A partition of patches, with the contacts between its groups."""

    def __init__(self, s: Surfaces, labels: np.ndarray) -> None:
        self.surfaces = s
        self.labels = labels
        bends = relations.bends(s, labels)
        order = np.argsort(labels, axis=None, kind="stable")
        starts = np.searchsorted(labels.ravel()[order], np.arange(1, labels.max() + 2))
        self.groups: dict[int, Group] = {
            number: relations.describe(s, order[starts[number - 1] : starts[number]], float(bends[number]))
            for number in range(1, int(labels.max()) + 1)
        }
        self.members: dict[int, list[int]] = {number: [number] for number in self.groups}
        self.patches = dict(self.groups)
        self.contacts = relations.contacts(s, labels)
        self.hinged: set[int] = set()
        self.bonds = Bonds(s)

    def contact(self, a: int, b: int) -> Contact:
        """The contact between two groups."""
        return self.contacts.get((min(a, b), max(a, b)), Contact())

    def odds(self, a: int, b: int) -> float:
        """Log odds by the network that two groups are one object."""
        return self.bonds.score(self.groups[a], self.groups[b], self.contact(a, b))

    def neighbours(self, a: int) -> list[int]:
        """Groups in contact with group `a` in the image."""
        return sorted({x + y - a for x, y in self.contacts if a in (x, y)})

    def join(self, a: int, b: int) -> int:
        """Merge two groups under the smaller number and return it."""
        keep, gone = min(a, b), max(a, b)
        self.members[keep] += self.members.pop(gone)
        for other in self.neighbours(gone):
            contact = self.contacts.pop((min(gone, other), max(gone, other)))
            if other != keep:
                self.contacts.setdefault((min(keep, other), max(keep, other)), Contact()).add(contact)
        first, second = self.groups[keep], self.groups.pop(gone)
        self.labels.ravel()[second.pixels] = keep
        sizes = len(first.pixels), len(second.pixels)
        bend = (first.bend * sizes[0] + second.bend * sizes[1]) / sum(sizes)
        pixels = np.concatenate([first.pixels, second.pixels])
        self.groups[keep] = relations.describe(self.surfaces, pixels, bend)
        return keep
