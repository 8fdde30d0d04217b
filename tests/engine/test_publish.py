"""What is published of nodes that ran, in workers or in this process."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from dextera_build import digest
from dextera_build.engine.graph import Graph
from dextera_build.engine.run import build
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from tests.engine.tiny import RUNNER, Record, call, graph, inline, leaf, out

PLAN = graph(call("a", "blob"), call("b", "print", "hello", a=out("a")), call("c", a=out("a"), b=out("b")))


def made(root: Path, pool: bool, plan: Graph = PLAN) -> dict[str, ActionResult | None]:
    store = Store(root)
    with LocalExecutor(RUNNER, Capacity(1, 4.0)) if pool else nullcontext(inline()) as executor:
        result = build(plan, plan.targets["default"], store=store, executor=executor, listen=Record())
    found = Store(root).actions
    return {name: found.get(node.key or "") for name, node in result.nodes.items()}


def test_workers_and_this_process_lead_to_the_same_results(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a leaf")
    plan = graph(*PLAN.members.values(), call("d", "print", "read", x=leaf(tmp_path / "file"), c=out("c")))
    pooled, here = made(tmp_path / "pool", pool=True, plan=plan), made(tmp_path / "inline", pool=False, plan=plan)
    for name, mine in pooled.items():
        other = here[name]
        assert mine is not None
        assert other is not None
        assert (mine.output, mine.line, mine.metrics, mine.key_document) == (
            other.output,
            other.line,
            other.metrics,
            other.key_document,
        )
    logs = {name: mine.log for name, mine in pooled.items() if mine and mine.log}
    assert logs == {
        "b": digest.of_bytes(b"hello\nand to stderr\n"),
        "d": digest.of_bytes(b"read\nand to stderr\n"),
    }


def test_nothing_is_published_of_a_node_whose_file_changed(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("as it was")
    plan = graph(call("a", "edit", str(file), x=leaf(file)))
    assert made(tmp_path / "store", pool=True, plan=plan) == {"a": None}
    assert list(Store(tmp_path / "store").actions.keys()) == []
