"""Names in simulator files: sanitized, unique labels."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from dextera_build.artifacts.objects.object import Asset, Body

RESERVED = ("world", "background", "capture", "support", "sun", "sky")


def body_names(labels: Iterable[str]) -> dict[str, str]:
    """Label -> a name of lower-case letters, digits and `_`, unique among `labels`."""
    taken = set(RESERVED)
    return {label: _take(plain(label), taken) for label in sorted(labels)}


def link_names(assets: Mapping[str, Asset]) -> dict[tuple[str, str], str]:
    """(label, link) -> the name of that link's body; a root link has the object's name."""
    roots = body_names(assets)
    taken = {*RESERVED, *roots.values()}
    names: dict[tuple[str, str], str] = {}
    for label in sorted(assets):
        root = root_link(assets[label].body)
        for link in sorted(assets[label].body.links):
            own = roots[label]
            names[label, link] = own if link == root else _take(f"{own}_{plain(link)}", taken)
    return names


def root_link(body: Body) -> str:
    """The link without a parent joint."""
    moved = {joint.child for joint in body.joints}
    return next(link for link in sorted(body.links) if link not in moved)


def plain(label: str) -> str:
    """`Blue Mug (2)` -> `blue_mug_2`; never empty, never starts with a digit."""
    word = re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_") or "object"
    return f"object_{word}" if word[0].isdigit() else word


def _take(wanted: str, taken: set[str]) -> str:
    name, number = wanted, 2
    while name in taken:
        name, number = f"{wanted}_{number}", number + 1
    taken.add(name)
    return name
