"""Graphs as files: nothing overlaps, edges pass under no box, text fits, collapse keeps what reads what."""

from __future__ import annotations

import random
import re
import xml.etree.ElementTree as ET
from itertools import combinations

import pytest

from dextera_build.report.collapse import collapse
from dextera_build.report.drawing import dot, svg
from dextera_build.report.run import Node, read
from tests.report.fabricate import fabricate

SVG = "{http://www.w3.org/2000/svg}"
Box = tuple[float, float, float, float]


def drawn(seed: int) -> list[Node]:
    """A graph of random size with two groups; 0 is the twin of the report's tests."""
    if not seed:
        return read(*fabricate()).nodes
    dice = random.Random(seed)
    names = [f"n{i}" if i % 3 else f"g{i % 2}[l{i % 5}].n{i}" for i in range(dice.randint(2, 60))]
    return [
        Node(
            i, name, f"r.{i % 7}", None, "", None, None, 0, 0, depends_on=[o for o in names[:i] if dice.random() < 0.1]
        )
        for i, name in enumerate(names)
    ]


def boxes(root: ET.Element) -> list[Box]:
    found = []
    for node in root.iter(f"{SVG}a"):
        rect = node.find(f"{SVG}rect")
        assert rect is not None
        x, y, width, height = (float(rect.get(name, "0")) for name in ("x", "y", "width", "height"))
        found.append((x, y, x + width, y + height))
        for text in node.iter(f"{SVG}text"):
            # A bold letter of 12 px is about 7 px wide.
            assert float(text.get("x", "0")) + 6.6 * len(text.text or "") <= x + width + 4, text.text
    return found


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("way", ["node", "group", "rule"])
def test_nothing_overlaps(seed: int, way: str) -> None:
    nodes = collapse(drawn(seed), way)
    root = ET.fromstring(svg("a/b", nodes))
    found = boxes(root)
    assert len(found) == len(nodes)
    width, height = float(root.get("width", "0")), float(root.get("height", "0"))
    assert all(x0 >= 0 and x1 <= width and y0 >= 0 and y1 <= height for x0, y0, x1, y1 in found)
    for (ax0, ay0, ax1, ay1), (bx0, by0, bx1, by1) in combinations(found, 2):
        assert ax1 < bx0 or bx1 < ax0 or ay1 < by0 or by1 < ay0
    for path in root.iter(f"{SVG}path"):
        level = re.search(r" ([\d.]+) ([\d.]+)H([\d.]+)", path.get("d", ""))
        if level:
            begin, y, end = (float(part) for part in level.groups())
            assert not [b for b in found if b[0] < max(begin, end) and b[2] > min(begin, end) and b[1] < y < b[3]]


def test_text_of_a_name_is_text() -> None:
    nodes = [Node(0, 'body[<b>&"].x', "r.s", None, "", None, None, 0, 0)]
    root = ET.fromstring(svg("a/<b>", nodes))
    assert "a/<b>" in [text.text for text in root.iter(f"{SVG}text")]


def test_collapsed_edges_are_those_of_their_members() -> None:
    nodes = drawn(0)
    for way, name in (("rule", lambda n: n.rule), ("group", lambda n: re.sub(r"\[[^]]*\]", "[*]", n.address))):
        by = {node.address: name(node) for node in nodes}
        wanted = {(by[s], by[n.address]) for n in nodes for s in n.depends_on if by[s] != by[n.address]}
        made = collapse(nodes, way)
        assert {(s, n.address) for n in made for s in n.depends_on} == wanted
        assert len(made) == len(set(by.values()))


def test_a_collapsed_box_has_the_state_of_the_worst() -> None:
    nodes = [Node(i, f"g[{i}].x", "r.s", None, s, None, None, 0, 0) for i, s in enumerate(["cached", "stale", "ran"])]
    (one,) = collapse(nodes, "group")
    assert (one.address, one.status, one.rule) == ("g[*].x", "stale", "3 × r.s")


def test_recipes_that_are_used_are_one_box_each() -> None:
    names = ["robot/arm:robot", "twin/a:scene", "twin/a:body[x].mesh", "mug/act", "score"]
    nodes = [Node(i, name, "r.s", None, "", None, None, 0, 0) for i, name in enumerate(names)]
    assert [node.address for node in collapse(nodes, "recipe")] == ["robot/arm", "twin/a", "mug", "(its own nodes)"]


def test_circles_of_rules_are_drawn() -> None:
    needs = {"a": [], "b": ["a"], "c": ["b"], "d": ["c"]}
    nodes = [
        Node(i, name, "r.x" if name in "ac" else "r.y", None, "", None, None, 0, 0, depends_on=needs[name])
        for i, name in enumerate(needs)
    ]
    made = collapse(nodes, "rule")
    assert [(node.address, node.depends_on) for node in made] == [("r.x", ["r.y"]), ("r.y", ["r.x"])]
    assert len(boxes(ET.fromstring(svg("a/b", made)))) == 2


def test_dot_quotes_what_it_must() -> None:
    nodes = [
        Node(0, 'body["x"].a', "r.s", None, "", None, None, 0, 0),
        Node(1, "b", "r.s", None, "ran", None, None, 0, 0),
    ]
    nodes[1].depends_on = ['body["x"].a', "unknown"]
    lines = dot("a/b", nodes).splitlines()
    assert lines[0] == 'digraph "a/b" {'
    assert '  "body[\\"x\\"].a" -> "b";' in lines
    assert not [line for line in lines if "unknown" in line]
