"""Members of a graph as texts: all that went in comes out, and in few bytes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.engine import compact
from dextera_build.engine.compact import Members, Names, Writer, members_of
from dextera_build.engine.graph import Address, Graph, Leaf, Pack
from dextera_build.engine.wiring import Wiring
from dextera_build.errors import Place
from dextera_build.store.store import Store
from tests.engine.tiny import call, facts, graph, group, item, leaf, out, run
from tests.oracle.graphs import RandomGraph


def test_random_graphs_come_back(tmp_path: Path) -> None:
    for seed in range(20):
        plan = RandomGraph(seed, tmp_path, reads=True).graph()
        again = members_of(plan)
        assert again == plan.members
        assert list(again) == list(plan.members)
        assert dict(again.items()) == plan.members
        assert members_of(Graph(plan.name, again, plan.targets)) is again


def test_groups_without_texts_come_first_and_get_some(tmp_path: Path) -> None:
    writer = Writer()
    other = facts(version=2)
    for one in (call("a"), call("b", rule=other, x=out("a"))):
        writer.add(one)
    around = group("g", out("a"), call("in", x=item("g"), y=Pack({"l": leaf(tmp_path / "l"), "o": out("b", "f")})))
    members = writer.members({"g": around})
    assert list(members) == ["g", "a", "b"]
    assert members["g"] is around
    spelled = members_of(Graph("x", members, {}))
    assert list(spelled) == ["g", "a", "b"]
    assert spelled == members
    assert spelled["b"].rule == other  # type: ignore[union-attr]
    assert not spelled.groups


def test_names_of_one_hash_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compact, "hash_of", len)
    monkeypatch.setattr(compact, "short_hash_of", len)
    plan = graph(call("a"), call("b", x=out("a")), call("long", x=out("b")))
    members = members_of(plan)
    assert members == plan.members
    assert "c" not in members
    assert not Names.of(["a", "b"]).are_distinct
    assert Names.of(["a", "bb"]).are_distinct


def test_a_place_and_a_path_of_any_bytes_come_back(tmp_path: Path) -> None:
    odd = Leaf(Path("/a/\udcff b"), Place("re\udcffcipe.yaml", 3, 4))
    writer = Writer()
    writer.add(call("a", x=odd))
    assert writer.members()["a"].inputs == {"x": odd}  # type: ignore[union-attr]


def test_a_build_reads_a_call_four_times_at_most(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []
    member = Members._member
    monkeypatch.setattr(compact, "_RECENT", 1)
    monkeypatch.setattr(Members, "_member", lambda self, number: read.append(number) or member(self, number))
    plain = graph(*(call(f"n{number}", value=number) for number in range(40)))
    packed = Graph(plain.name, members_of(plain), plain.targets)
    targets = [Address((name,)) for name in plain.members]
    read.clear()
    assert run(packed, store, *targets)[0].ok
    # To see that its files are there, to connect it, for its key, and for its task; each target is looked for once.
    assert len(read) <= 5 * len(targets)
    read.clear()
    assert run(packed, store, *targets)[0].ok
    assert len(read) <= 4 * len(targets)


def held(make: Callable[[int], object], few: int = 500, many: int = 1_500) -> float:
    """Bytes that each further node takes while `make` runs, at most."""
    peaks = []
    for count in (few, few, many):
        tracemalloc.start()
        made = make(count)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        del made
    return (peaks[2] - peaks[1]) / (many - few)


def test_a_call_takes_few_bytes() -> None:
    def write(count: int) -> Members:
        writer = Writer()
        for number in range(count):
            writer.add(call(f"n{number}", x=Pack({name: out(f"n{number // 2}") for name in "abc"})))
        return writer.members()

    assert held(write) < 260


def test_a_node_takes_few_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compact, "_RECENT", 1)  # calls at hand are few among many nodes

    def wire(count: int) -> object:
        first = [call(f"n{number}", value=number) for number in range(10)]
        later = (
            call(f"n{number}", x=Pack({slot: out(f"n{number - back}") for back, slot in enumerate("abc", 1)}))
            for number in range(10, count)
        )
        plain = graph(*first, *later)
        packed = Graph(plain.name, members_of(plain), plain.targets)
        del plain, first
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        wiring = Wiring(packed, str)
        wiring.ask([Address((f"n{count - 1}",))])
        while wiring.fresh:
            wiring.connect(wiring.fresh.popleft())
        for node in wiring.nodes.values():
            node.key, node.output, node.made_s = digest.of_bytes(b"k"), digest.of_bytes(b"o"), 0.5
        taken.append(tracemalloc.get_traced_memory()[0] - before)
        return wiring

    taken: list[int] = []
    held(wire, 2_000, 6_000)
    assert (taken[2] - taken[1]) / 4_000 < 580
