"""The tree of links and joints of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from dextera_build.errors import listing
from dextera_build.sim.model.imported.files import wrong


def children_of(links: Mapping[str, ET.Element], joints: Mapping[str, ET.Element]) -> dict[str, list[tuple[str, str]]]:
    """Link -> its joints and their children.

    Raises:
        RuleError: An end of a joint is no link, or the links form no tree.
    """
    children: dict[str, list[tuple[str, str]]] = {name: [] for name in links}
    above: dict[str, str] = {}
    for name, joint in joints.items():
        ends = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = "" if element is None else element.get("link", "")
            if link not in links:
                raise wrong(
                    f"the {end} of joint `{name}` is `{link}`, but no link is called so",
                    links=listing(links, most=40),
                )
            ends.append(link)
        if ends[1] in above:
            raise wrong(
                f"link `{ends[1]}` is the child of two joints, `{above[ends[1]]}` and `{name}`",
                hint="a robot is a tree: leave out the joint that closes the loop",
            )
        above[ends[1]] = name
        children[ends[0]].append((name, ends[1]))
    tops = [name for name in links if name not in above]
    reached, waiting = set(tops), list(tops)
    while waiting:
        below = [child for _, child in children[waiting.pop()]]
        reached |= set(below)
        waiting += below
    if set(links) - reached:
        loop = sorted(set(links) - reached)
        raise wrong("the links form a cycle", links=listing(loop), hint="a robot is a tree")
    if len(tops) != 1:
        raise wrong(f"there are {len(tops)} links without a parent", links=listing(tops), hint="join them by joints")
    return children
