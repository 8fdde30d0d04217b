"""Joints of a robot's MJCF before and beyond a frame, read from the text without a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree


def chain(model: Any, site: str, links: Mapping[str, str]) -> tuple[set[str], set[str]] | None:
    """Joints between the base and a site, and joints of the hand that the site belongs to.

    The hand consists of the descendants of the first link of class `hand` on that path, or of the site's own link.

    Args:
        model: Folder with `robot.xml`.
        site: MJCF site of the palm.
        links: MJCF body -> `arm` or `hand`.

    Returns:
        Both sets of names, or None if the file is no MJCF or has no such site.
    """
    way = _way(model, site)
    if way is None:
        return None
    first = next((body for body in way if links.get(body.get("name", "")) == "hand"), way[-1])
    above = {name for body in way for name in _joints(body)}
    return above, {name for body in first.iter("body") for name in _joints(body)}


def _way(model: Any, site: str) -> list[ElementTree.Element] | None:
    """Bodies on the path from the base to the body of the site."""
    try:
        root = ElementTree.fromstring(model.files["robot.xml"])
    except (KeyError, ElementTree.ParseError, ValueError):
        return None
    parents = {child: parent for parent in root.iter() for child in parent}
    place = next((each for each in root.iter("site") if each.get("name") == site), None)
    if place is None:
        return None
    way: list[ElementTree.Element] = []
    above: ElementTree.Element | None = parents[place]
    while above is not None:
        if above.tag == "body":
            way.insert(0, above)
        above = parents.get(above)
    return way or None


def _joints(body: ElementTree.Element) -> list[str]:
    return [child.get("name", "") for child in body if child.tag in ("joint", "freejoint")]
