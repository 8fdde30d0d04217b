"""A partition of patches into groups, which can be joined."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from . import relations
from .bonds import Bonds
from .patches import Surfaces
from .relations import Contact, Group

FEWEST = 12
"""Contacts with fewer pixel pairs are ignored."""


class Grouping:
    """A partition of patches, with the contacts between its groups.

    Args:
        s: The surface.
        labels: (h, w) int32, patch of each pixel, 1..; it becomes the group's number.
        apart: Pairs of patches of two objects.
    """

    def __init__(self, s: Surfaces, labels: np.ndarray, apart: Iterable[tuple[int, int]] = ()) -> None:
        self.surfaces = s
        self.labels = labels
        self.apart = tuple(apart)
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
        self.between = {pair: replace(contact) for pair, contact in self.contacts.items()}
        self.joins: list[tuple[frozenset[int], frozenset[int]]] = []
        self.hinged: set[int] = set()
        self.bonds = Bonds(s)

    def contact(self, a: int, b: int) -> Contact:
        """The contact between two groups."""
        return self.contacts.get((min(a, b), max(a, b)), Contact())

    def odds(self, a: int, b: int) -> float:
        """Log odds by the network that two groups are one object; -inf if they have patches of two objects."""
        own, others = self.members[a], self.members[b]
        if any((p in own and q in others) or (q in own and p in others) for p, q in self.apart):
            return -np.inf
        return self.bonds.score(self.groups[a], self.groups[b], self.contact(a, b))

    def neighbours(self, a: int) -> list[int]:
        """Groups in contact with group `a` in the image."""
        return sorted({x + y - a for x, y in self.contacts if a in (x, y)})

    def join(self, a: int, b: int) -> int:
        """Merge two groups under the smaller number and return it."""
        keep, gone = min(a, b), max(a, b)
        self.joins.append((frozenset(self.members[keep]), frozenset(self.members[gone])))
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

    def contact_of(self, some: frozenset[int], others: frozenset[int]) -> Contact:
        """The contact between two sets of patches."""
        found = Contact()
        for (a, b), contact in self.between.items():
            if (a in some and b in others) or (b in some and a in others):
                found.add(contact)
        return found

    def union(self, some: Iterable[int]) -> Group:
        """What a group of these patches would be."""
        own = [self.patches[number] for number in sorted(some)]
        sizes = np.array([len(patch.pixels) for patch in own])
        bend = float((sizes * [patch.bend for patch in own]).sum() / sizes.sum())
        return relations.describe(self.surfaces, np.concatenate([patch.pixels for patch in own]), bend)

    def part(self, number: int, some: frozenset[int]) -> tuple[int, int]:
        """Divide a group into these patches and the others; the numbers of both."""
        sides = some, frozenset(self.members.pop(number)) - some
        del self.groups[number]
        for other in self.neighbours(number):
            del self.contacts[min(number, other), max(number, other)]
        for own in sides:
            new = min(own)
            self.members[new], self.groups[new] = sorted(own), self.union(own)
            self.labels.ravel()[self.groups[new].pixels] = new
            for other, members in self.members.items():
                contact = self.contact_of(own, frozenset(members))
                if other != new and contact.pairs:
                    self.contacts[min(new, other), max(new, other)] = contact
        return min(sides[0]), min(sides[1])
