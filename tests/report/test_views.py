"""The parts of the report that compute: layout, edges, slots, critical path, words, builder."""

from __future__ import annotations

import itertools
import random

import pytest

from dextera_build.report import wording
from dextera_build.report.html import Html, join, tag
from dextera_build.report.layout import lay_out, reduced, topological
from dextera_build.report.run import Node, Run, read
from dextera_build.report.timeline import assign_slots, critical_path
from tests.report.fabricate import FakeStore, fabricate


def node(
    index: int, address: str, needs: list[str], began: float = 0.0, ended: float = 0.0, status: str = "ran"
) -> Node:
    return Node(index, address, "a.b", None, status, None, None, began, ended, depends_on=needs)


def reachable(edges: list[tuple[str, str]]) -> set[tuple[str, str]]:
    found = set(edges)
    while True:
        more = {(a, d) for a, b in found for c, d in edges if b == c} - found
        if not more:
            return found
        found |= more


@pytest.mark.parametrize("seed", range(20))
def test_reduced_edges_reach_the_same_and_none_is_spare(seed: int) -> None:
    dice = random.Random(seed)
    nodes = [node(i, f"n{i}", [f"n{j}" for j in range(i) if dice.random() < 0.3]) for i in range(12)]
    dice.shuffle(nodes)
    full = [(need, n.address) for n in nodes for need in n.depends_on]
    kept = [(a.address, b.address) for a, b in reduced(nodes)]
    assert reachable(kept) == reachable(full)
    for edge in kept:
        assert edge not in reachable([other for other in kept if other != edge])


@pytest.mark.parametrize("seed", range(10))
def test_topological_order_and_columns_follow_every_edge(seed: int) -> None:
    dice = random.Random(seed)
    nodes = [node(i, f"n{i}", [f"n{j}" for j in range(i) if dice.random() < 0.2]) for i in range(30)]
    dice.shuffle(nodes)
    place = {n.address: i for i, n in enumerate(topological(nodes))}
    cells = {cell.node.address: cell for lane in lay_out(Run(nodes=nodes)).lanes for cell in lane.cells}
    assert len(place) == len(cells) == 30
    for n in nodes:
        for need in n.depends_on:
            assert place[need] < place[n.address]
            assert cells[need].column < cells[n.address].column
    assert len({(cell.column, cell.row) for cell in cells.values()}) == 30


def test_order_of_a_long_chain_and_of_a_cycle() -> None:
    chain = [node(i, f"n{i}", [f"n{i - 1}"] if i else []) for i in range(5000)][::-1]
    assert [n.address for n in topological(chain)] == [f"n{i}" for i in range(5000)]
    loop = [node(0, "a", ["b"]), node(1, "b", ["a"])]
    assert {n.address for n in topological(loop)} == {"a", "b"}


def test_copies_of_a_call_line_up_and_lanes_do_not_overlap() -> None:
    run = read(*fabricate("cold"))
    layout = lay_out(run)
    assert [lane.title for lane in layout.lanes[:3]] == [(), ("body", "laptop"), ("body", "blue_mug")]
    columns: dict[str, set[tuple[int, int]]] = {}
    for lane in layout.lanes[1:]:
        for cell in lane.cells:
            columns.setdefault(cell.node.name, set()).add((cell.column, cell.row - lane.top))
            assert lane.top <= cell.row < lane.top + lane.rows
    assert all(len(places) == 1 for places in columns.values())
    tops = [(lane.top, lane.top + lane.rows) for lane in layout.lanes]
    assert all(a[1] == b[0] for a, b in itertools.pairwise(tops))


def test_failed_copies_are_drawn_first_when_there_are_too_many() -> None:
    nodes = [node(i, f"body[x{i}].mesh", [], status="failed" if i == 7 else "ran") for i in range(10)]
    layout = lay_out(Run(nodes=nodes), most_lanes=3)
    assert [lane.title for lane in layout.lanes] == [("body", "x7"), ("body", "x0"), ("body", "x1")]
    assert layout.hidden == 7


def test_addresses_are_taken_apart() -> None:
    inner = node(0, "body[mug.2].part[lid].mesh", [])
    assert inner.call == ("body", "part", "mesh")
    assert inner.labels == ("mug.2", "lid")
    assert inner.name == "mesh"
    assert node(0, "scene", []).labels == ()


def test_slots_never_hold_two_nodes_at_once_and_no_more_than_ran_together() -> None:
    dice = random.Random(1)
    worked = [node(i, f"n{i}", [], began := dice.random() * 10, began + dice.random() * 4) for i in range(40)]
    slots = assign_slots(worked)
    for row in set(slots.values()):
        spans = sorted((n.began, n.ended) for n in worked if slots[n.index] == row)
        assert all(a[1] <= b[0] + 1e-3 for a, b in itertools.pairwise(spans))
    together = max(sum(a.began <= n.began < a.ended for a in worked) for n in worked)
    assert max(slots.values()) + 1 == together


def test_critical_path_goes_through_what_came_last() -> None:
    nodes = [
        node(0, "fast", [], 0, 1),
        node(1, "slow", [], 0, 5),
        node(2, "known", [], 0, 0, "cached"),
        node(3, "middle", ["fast", "slow", "known"], 5, 6),
        node(4, "aside", ["fast"], 1, 3),
        node(5, "last", ["middle", "aside"], 6, 9),
    ]
    assert [n.address for n in critical_path(Run(nodes=nodes))] == ["slow", "middle", "last"]
    assert critical_path(Run(nodes=[nodes[2]])) == []


def test_a_node_that_was_made_again_counts_once() -> None:
    events, store = fabricate("cold")
    done = next(event for event in events if event.kind == "node_finished")
    assert len(read([*events, done], store).nodes) == len(read(events, store).nodes) == 38


def test_a_node_log_in_the_events_is_kept_where_the_store_has_none() -> None:
    events, _ = fabricate("cold")
    run = read(events, FakeStore())
    assert run.by_address()["body[laptop].mesh"].log == "revolved scores 0.93"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (-0.1, "0.00 s"),
        (0.31, "0.31 s"),
        (0.996, "1.0 s"),
        (58.34, "58.3 s"),
        (99.97, "1 min 40 s"),
        (599.6, "10 min"),
        (1260, "21 min"),
        (3599, "1 h 00 min"),
        (7500, "2 h 05 min"),
    ],
)
def test_duration(seconds: float, text: str) -> None:
    assert wording.duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (41, "41"),
        (12345.0, "12,345"),
        (12345.6, "12,346"),
        (0.9731, "0.9731"),
        (0.00042, "0.00042"),
        (1.5, "1.5"),
        (-3.14159, "-3.142"),
        (2.1e-7, "2.1e-07"),
    ],
)
def test_number(value: float, text: str) -> None:
    assert wording.number(value) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0004512, "% of m g h", "< 0.01 % of m g h"),
        (8.89e-13, "%", "< 0.01 %"),
        (0.0, "%", "0 %"),
        (98.125, "%", "98.12 %"),
        (0.000246, "MB", "246 B"),
        (4.6, "MB", "4.6 MB"),
        (0.00045, "m", "0.45 mm"),
        (0.0000004, "m", "0.4 µm"),
        (0.03, "kg", "30 g"),
        (1.36, "m", "1.36 m"),
        (19535.0, "cm3", "19,535 cm³"),
        (-0.0123, "m", "-12.3 mm"),
        (12.92, "dB", "12.92 dB"),
        (5, "", "5"),
        (3, "of 5", "3 of 5"),
    ],
)
def test_quantities_are_written_as_people_do(value: float, unit: str, text: str) -> None:
    assert wording.quantity(value, unit) == text


def test_counts_and_lists() -> None:
    assert wording.count(1, "node") == "1 node"
    assert wording.count(1204, "node") == "1,204 nodes"
    assert wording.states({"cached": 9, "ran": 1, "waits": 2, "failed": 0}) == "1 ran, 9 cached, 2 wait"
    assert wording.some("abc", 2) == "a, b and 1 more"


def test_builder_escapes_text_and_values_but_not_markup() -> None:
    inner = tag("b", None, "1 < 2")
    assert inner == "<b>1 &lt; 2</b>"
    assert tag("p", {"title": '"&', "hidden": True, "id": None, "x": 2.0}, inner, None, ["a", 3]) == (
        '<p title="&quot;&amp;" hidden x="2"><b>1 &lt; 2</b>a3</p>'
    )
    assert tag("img", {"src": "a"}) == '<img src="a">'
    assert isinstance(join(["<"]), Html)
    assert join(["<"]) == "&lt;"
