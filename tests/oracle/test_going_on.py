"""A build that goes on from the last one finds what a build that looks at everything finds."""

from __future__ import annotations

import json
import random
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from dextera_build.engine import compact, eventlog, known
from dextera_build.engine.eventlog import EventLog
from dextera_build.engine.events import NodeFinished, NodesKept, fan_out
from dextera_build.engine.execute import RunInfo, RunResult, build
from dextera_build.engine.graph import Address, Fixed, Graph
from dextera_build.engine.history import History
from dextera_build.engine.known import Known
from dextera_build.engine.reach import leaves
from dextera_build.engine.retries import Retries
from dextera_build.engine.units import Node
from dextera_build.store.store import Store
from dextera_build.store.traces.look import Look
from tests.engine.tiny import Record, call, facts, graph, group, inline, item, leaf, out, run
from tests.oracle.graphs import RandomGraph


@dataclass
class Built:
    """What a build did."""

    result: RunResult
    record: Record
    run: str

    @property
    def outcome(self) -> dict[str, tuple[object, ...]]:
        """All that must be equal, by node."""
        return {
            name: (node.status, node.key, node.output, node.line, node.inputs, node.rule, node.log)
            for name, node in self.result.nodes.items()
        }


def go(graph: Graph, targets: list[Address], root: Path, found: Known | None = None) -> Built:
    record, store = Record(), Store(root)
    with EventLog(store) as log:
        result = build(
            graph,
            targets,
            store=store,
            executor=inline(),
            listen=fan_out(record, log),
            info=RunInfo(run=log.run),
            known=found,
        )
    return Built(result, record, log.run)


def said(root: Path, run: str) -> dict[str, dict[str, object]]:
    """What the log says of each node in the end, without what differs from run to run (`result` holds seconds)."""
    found = {}
    for event in eventlog.read(Store(root), run):
        if event["event"] == NodeFinished.kind:
            event["depends_on"].sort()
            event["usage"] = sorted(event["usage"])  # what was measured, not how much
            found[event["node"]] = {
                name: value for name, value in event.items() if name not in ("time", "seconds", "result")
            }
    return found


def remembered(root: Path) -> dict[str, tuple[str, str]]:
    return {name: (entry.key, entry.key_document) for name, entry in History(Store(root), "tiny/graph").all().items()}


@pytest.mark.parametrize("seed", range(80))
def test_it_finds_what_a_whole_build_finds(seed: int, tmp_path: Path) -> None:
    random_graph, root, path = RandomGraph(seed, tmp_path, reads=True), tmp_path / "store", tmp_path / "snapshot"
    plan, targets = random_graph.graph(), random_graph.targets()
    first = go(plan, targets, root)
    assert first.result.wiring is not None
    assert known.write(path, plan, first.result.wiring, first.run)
    for step in range(4):
        changed = edit(random_graph, step)
        whole_root = tmp_path / f"whole{step}"
        shutil.copytree(root, whole_root)
        whole = go(plan, targets, whole_root)
        found = known.read(path)
        asked, _ = found.reread.changed(map(str, changed), Look(tmp_path, Store(root).leaves, root))
        if not found.spread((str(file) for file in changed if str(file) in found.head["leaves"]), asked):
            assert any(name.startswith("g") for name in plan.members)
            return
        assert found.graph == plan
        built = go(found.graph, targets, root, found)
        assert built.outcome == whole.outcome
        assert sorted(built.record.with_status("ran")) == sorted(whole.record.with_status("ran"))
        assert built.result.targets == whole.result.targets
        assert said(root, built.run) == said(whole_root, whole.run)
        assert remembered(root) == remembered(whole_root)
        ends = [built.record.events[-1], whole.record.events[-1]]
        assert ends[0].counts == ends[1].counts  # type: ignore[attr-defined]
        found.write_state(path)


def edit(random_graph: RandomGraph, step: int) -> list[Path]:
    dice = random.Random(step)
    files = dice.sample(random_graph.files, dice.randint(0, 2))
    for file in files:
        file.write_text(f"content {dice.randint(0, 2)} of step {step}{'.' * dice.randint(0, 3)}")
    return files


def test_the_graph_comes_back_whole(tmp_path: Path) -> None:
    for seed in range(40):
        random_graph = RandomGraph(seed, tmp_path, reads=True)
        plan, targets = random_graph.graph(), random_graph.targets()
        built = go(plan, targets, tmp_path / f"store{seed}")
        assert built.result.wiring is not None
        known.write(tmp_path / "snapshot", plan, built.result.wiring, "1")
        again = known.read(tmp_path / "snapshot").graph
        assert again == plan
        assert list(again.members) == list(plan.members)
        read = {leaf.path for leaf in leaves(again, targets)}
        assert read <= set(random_graph.files)


def deep(files: list[Path], length: int) -> Graph:
    """Chains over several files, and one that reads them all."""
    members = []
    for number, file in enumerate(files):
        members.append(call(f"c{number}x0", a=leaf(file)))
        members += [call(f"c{number}x{place}", a=out(f"c{number}x{place - 1}")) for place in range(1, length)]
    ends = {f"e{number}": out(f"c{number}x{length - 1}") for number in range(len(files))}
    return graph(*members, call("all", "const", **ends))


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    found = [tmp_path / f"leaf{number}" for number in range(20)]
    for file in found:
        file.write_text(file.name)
    return found


def resumed(plan: Graph, root: Path, path: Path, changed: list[Path]) -> tuple[Built, Known]:
    found = known.read(path)
    assert found.spread(map(str, changed))
    return go(found.graph, [Address(call) for call in plan.targets["default"]], root, found), found


def started(plan: Graph, root: Path, path: Path) -> Built:
    built = go(plan, [Address(call) for call in plan.targets["default"]], root)
    assert built.result.wiring is not None
    assert known.write(path, plan, built.result.wiring, built.run)
    return built


def test_only_what_stands_above_the_change_is_looked_at(
    tmp_path: Path, files: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, root, path = deep(files, 30), tmp_path / "store", tmp_path / "snapshot"
    started(plan, root, path)
    files[3].write_text("other")
    looks: list[str] = []
    get = type(Store(root).actions).get
    monkeypatch.setattr(
        "dextera_build.store.actions.Actions.get", lambda self, key: looks.append(key) or get(self, key)
    )
    built, found = resumed(plan, root, path, [files[3]])
    assert len(built.record.with_status("ran")) == 31  # the chain and what reads all
    assert len(looks) <= 2 * 31
    assert len(found.cone) == 31
    assert built.result.wiring is not None
    assert len(built.result.wiring.nodes) <= 31 + len(files)
    assert built.record.of(NodesKept)[0].nodes == len(files) * 30 - 30


def test_an_equal_output_stops_the_wave(tmp_path: Path, files: list[Path]) -> None:
    chain = [call("a", "const", x=leaf(files[0])), call("b", x=out("a")), call("c", x=out("b"))]
    plan, root, path = graph(*chain), tmp_path / "store", tmp_path / "snapshot"
    started(plan, root, path)
    files[0].write_text("other")
    built, _ = resumed(plan, root, path, [files[0]])
    assert built.record.with_status("ran") == ["a"]
    assert built.record.with_status("cached") == ["b", "c"]


def test_a_group_that_may_open_anew_is_planned_anew(tmp_path: Path, files: list[Path]) -> None:
    body = group("body", out("seg"), call("mesh", seen=item("body"), extra=leaf(files[1])))
    plan = graph(call("seg", "labels", x=leaf(files[0])), body, default=("body.mesh",))
    root, path = tmp_path / "store", tmp_path / "snapshot"
    started(plan, root, path)
    assert not known.read(path).spread([str(files[0])])
    files[1].write_text("other")
    built, _ = resumed(plan, root, path, [files[1]])
    assert {name.split("[")[0] for name in built.record.with_status("ran")} == {"body"}


@pytest.mark.parametrize("damage", ["deleted", "flipped"])
def test_bytes_that_are_gone_are_made_again(tmp_path: Path, files: list[Path], damage: str) -> None:
    plan = graph(call("a", x=leaf(files[0])), call("b", x=leaf(files[1])), call("c", a=out("a"), b=out("b")))
    root, path = tmp_path / "store", tmp_path / "snapshot"
    first = started(plan, root, path)
    blob = Store(root).blobs.path(first.result.nodes["b"].output or "")
    blob.chmod(0o644)
    data = blob.read_bytes()
    blob.unlink() if damage == "deleted" else blob.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    files[0].write_text("other")
    built, _ = resumed(plan, root, path, [files[0]])
    assert built.result.ok
    assert set(built.record.with_status("ran")) == {"a", "b", "c"}
    assert built.result.nodes["b"].output == first.result.nodes["b"].output


def test_a_failure_leaves_what_was_known(tmp_path: Path, files: list[Path]) -> None:
    plan = graph(call("a", x=leaf(files[0])), call("b", "fail", a=out("a")), default=("a",))
    root, path = tmp_path / "store", tmp_path / "snapshot"
    started(plan, root, path)
    before = Path(f"{path}.known").read_bytes()
    failing = graph(call("a", "fail", x=leaf(files[0])))
    found = known.read(path)
    files[0].write_text("other")
    assert found.spread([str(files[0])])
    found.graph = failing
    built = go(failing, [Address(("a",))], root, found)
    assert not built.result.ok
    assert built.result.nodes["a"].status == "failed"
    assert found.keys == known.read(path).keys
    assert Path(f"{path}.known").read_bytes() == before


@pytest.mark.parametrize("ending", [".plan", ".known"])
def test_any_damage_shows(tmp_path: Path, files: list[Path], ending: str) -> None:
    path = tmp_path / "snapshot"
    started(deep(files[:2], 2), tmp_path / "store", path)
    file = Path(f"{path}{ending}")
    whole = file.read_bytes()
    file.chmod(0o644)
    for place in range(0, len(whole), 7):
        for broken in (whole[:place], whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]):
            file.write_bytes(broken)
            with pytest.raises((ValueError, KeyError)):
                known.read(path)


def test_a_chain_of_many_nodes_goes_on(tmp_path: Path, files: list[Path]) -> None:
    plan, root, path = deep(files[:2], 2000), tmp_path / "store", tmp_path / "snapshot"
    started(plan, root, path)
    files[0].write_text("other")
    built, found = resumed(plan, root, path, [files[0]])
    assert len(found.cone) == 2001
    assert len(built.record.with_status("ran")) == 2001
    assert isinstance(next(iter(built.result.wiring.nodes.values())), Node) if built.result.wiring else False
    again, _ = run(plan, Store(root))
    assert {node.status for node in again.nodes.values()} == {"cached"}


def test_what_rules_declare_and_labels_of_a_recipe_come_back(tmp_path: Path) -> None:
    rich = facts(
        cpus=3, memory_gb=2.5, gpus=1, gpu_gb=0.5, named=(("seat", 2.0),), retries=Retries(2, ("OSError",), 0.25)
    )
    assert compact.facts_of(json.loads(json.dumps(compact.facts_to_plain(rich)))) == rich
    assert compact.facts_of(compact.facts_to_plain(rich)).needs == rich.needs
    text = tmp_path / "text"
    text.write_text("one")
    plan = graph(
        call("a", a=leaf(text)),
        group("g", Fixed(("p", "q")), call("c", a=out("a")), q=call("c", value=2, a=out("a"))),
        call("all", "const", a=out("a")),
    )
    targets, root, path = [Address(("g", "c")), Address(("all",))], tmp_path / "store", tmp_path / "snapshot"
    first = go(plan, targets, root)
    assert first.result.wiring is not None
    known.write(path, plan, first.result.wiring, first.run, lambda address: 0.5 if address == "a" else None)
    found = known.read(path)
    assert found.graph == plan
    assert [found.peak_gb(address) for address in ("a", "all", "nobody")] == [0.5, None, None]
    text.write_text("two")
    assert found.spread([str(text)])
    built = go(found.graph, targets, root, found)
    assert sorted(built.record.with_status("ran")) == ["a", "all", "g[p].c", "g[q].c"]
    assert built.result.ok
