"""Every file of a store cut short at any byte, and with any byte changed: the next build is right all the same."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.engine.graph import Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult, build
from dextera_build.gc.verify import verify
from dextera_build.runs import log as eventlog
from dextera_build.runs.events import fan_out
from dextera_build.runs.log import EventLog
from dextera_build.store.state import State
from dextera_build.store.store import Store
from tests.chaos.children import dxb
from tests.chaos.scenarios import PLAIN, project
from tests.engine.tiny import Record, call, graph, group, inline, item, leaf, out

STEPS = [pytest.param(1, marks=[pytest.mark.slow, pytest.mark.timeout(3000)], id="every byte"), 149]


def scene(photo: Path) -> Graph:
    return graph(
        call("seg", "items", {"box": "b"}, photo=leaf(photo)),
        group("body", out("seg"), call("mesh", "blob", seen=item("body"))),
        call("say", "print", "words", photo=leaf(photo)),
        call("end", "blob", photo=leaf(photo), say=out("say"), mesh=out("seg")),
        default=("end", "body.mesh"),
    )


def run(plan: Graph, root: Path) -> RunResult:
    """Build in a process that remembers nothing; `end` runs and reads all that it stands on."""
    store = Store(root)
    targets = plan.targets["default"]
    return build(
        plan, targets, store=store, executor=inline(), listen=Record(), policy=RunPolicy(force=frozenset({"end"}))
    )


def variants(data: bytes, step: int, first: int) -> Iterator[tuple[int, bytes]]:
    """The bytes cut at every `step`-th place, and with one bit flipped there."""
    for place in range(first % step, len(data), step):
        yield place, data[:place]
        yield place, data[:place] + bytes([data[place] ^ (1 << place % 8)]) + data[place + 1 :]


def replace(path: Path, data: bytes) -> None:
    """Put something in the place of a file, which a build may have set aside since."""
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


@pytest.mark.medium
@pytest.mark.parametrize("step", STEPS)
def test_damage_at_any_byte_of_a_store_costs_a_rebuild_at_most(tmp_path: Path, step: int) -> None:
    """Promise: no damaged byte of the store reaches a result, and none stops a build."""
    root, photo = tmp_path / "store", tmp_path / "photo"
    photo.write_bytes(b"pixels")
    with EventLog(Store(root)) as log:
        plan = scene(photo)
        build(plan, plan.targets["default"], store=Store(root), executor=inline(), listen=fan_out(log, Record()))
    right = {name: node.output for name, node in run(plan, root).nodes.items()}
    files = sorted(path for path in root.rglob("*") if path.is_file() and path.name != "locks")
    assert {path.relative_to(root).parts[0] for path in files} == {"CACHEDIR.TAG", "ac", "cas", "local", "runs"}
    for number, path in enumerate(files):
        data = path.read_bytes()
        for place, damaged in variants(data, step, number * 31):
            replace(path, damaged)
            if path.name == "events.jsonl":
                eventlog.read(Store(root), path.parent.name)
                continue
            again = run(plan, root)
            assert again.ok, (path, place)
            assert {name: node.output for name, node in again.nodes.items()} == right, (path, place)
        replace(path, data)
    verify(Store(root), repair=True)
    assert run(plan, root).ok
    assert verify(Store(root)).is_whole


@pytest.mark.medium
@pytest.mark.parametrize("step", STEPS)
def test_damage_at_any_byte_of_the_local_state_is_seen(tmp_path: Path, step: int) -> None:
    """Promise: no damaged byte of what a machine remembers becomes an answer."""
    space = project(tmp_path / "project")
    for _ in range(3):  # a build of files that are not at rest yet leaves no snapshot
        assert dxb(space.root, *PLAIN).code == 0
    path = space.root / "cache/local/state.db"
    data = path.read_bytes()
    right = {kind: State(str(path)).all(kind) for kind in State(str(path)).kinds()}
    assert right.keys() >= {"snapshot", "leaf"}
    for place, damaged in variants(data, 40 * step, 7):
        replace(path, damaged)
        for kind, rows in right.items():
            assert State(str(path)).all(kind).items() <= rows.items(), (kind, place)
        replace(path, damaged)
        answer = dxb(space.root, "get", "say/words:all") if place % 5 == 0 else None
        assert answer is None or answer.code == 0 or "error[DXB-" in answer.err, place
