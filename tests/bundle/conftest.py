"""A store with a small build, and its bundle."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.bundle.closure_of_targets import survey
from dextera_build.bundle.config import Build, Closure, Contents
from dextera_build.bundle.export import Export
from dextera_build.digest import canonical
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.key import Writer
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests.bundle.forge import unpacked
from tests.engine.tiny import call, every, graph, group, item, leaf, out, run

RECIPE = "nodes: {}\n"
Bundling = Callable[..., Export]


def small(file: Path) -> Graph:
    """A file, a group over its items, and a target; one output has a blob beside its header."""
    return graph(
        call("read", file=leaf(file)),
        call("seg", "items", {"box": "b", "mug": "m"}, read=out("read")),
        group("body", out("seg"), call("mesh", "blob", seen=item("body"))),
        call("scene", "blob", all=every("body.mesh")),
    )


def bundle(store: Store, plan: Graph, closure: Closure = "targets") -> Export:
    """The bundle of a graph's default targets."""
    found = survey(plan, [Address(name) for name in plan.targets["default"]], store, closure, lambda path: path.name)
    assert found.stale == ()
    build = Build("tiny/graph", found.targets, "cpu", found.nodes)
    return Export(store, Contents(closure, "1.0", (build,), {"tiny/graph": RECIPE}))


def large(store: Store, file: Path, size: int) -> Export:
    """The bundle of one result with one blob of this size, which is written to `file` first."""
    file.write_bytes(b"")
    os.truncate(file, size)
    digest, _ = store.blobs.put_file(file)
    one = call("large", "const", "x")
    document = store.blobs.put(Writer().document(one, {}))
    output = store.blobs.put(canonical({"artifact": "Film", "fields": {"data": {"$bytes": [digest, size]}}}))
    store.actions.put(document, ActionResult(output, "", (), {}, 1.0, None, document))
    return bundle(store, graph(one))


@pytest.fixture
def plan(tmp_path: Path) -> Graph:
    (tmp_path / "photo.bin").write_bytes(b"photo")
    return small(tmp_path / "photo.bin")


@pytest.fixture
def store(tmp_path: Path, plan: Graph) -> Store:
    """Holds the results of `plan`."""
    made = Store(tmp_path / "store")
    assert run(plan, made)[0].ok
    return made


@pytest.fixture
def other(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "other")


@pytest.fixture
def folder(tmp_path: Path, store: Store, plan: Graph) -> Path:
    """A good bundle with all results, unpacked."""
    bundle(store, plan, "full").write(tmp_path / "bundle.tar")
    return unpacked(tmp_path / "bundle.tar")
