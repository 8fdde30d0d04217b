"""A bundle from one store is imported into another."""

from __future__ import annotations

import os
import tracemalloc

import pytest

from dextera_build.bundle import importer, layout
from dextera_build.bundle.closure_of_targets import survey
from dextera_build.bundle.config import Contents
from dextera_build.digest import canonical
from dextera_build.engine.graph import Address
from dextera_build.store.entry import ActionResult
from tests.bundle.conftest import bundle, large
from tests.bundle.forge import packed, take
from tests.engine.tiny import run


@pytest.mark.parametrize("closure", ["targets", "full"])
def test_results_arrive(tmp_path, store, other, plan, closure):
    bundle(store, plan, closure).write(tmp_path / "bundle.tar")
    taken = take(tmp_path / "bundle.tar", other)
    keys = set(other.actions.keys())
    assert keys == set(store.actions.keys())
    whole = keys if closure == "full" else {last_key(plan, store)}
    assert taken == importer.Taken(len(keys), len(keys - whole), 0, ())
    for key in keys:
        assert other.actions.known(key) == store.actions.get(key)
    for key in whole:
        assert other.actions.get(key) == store.actions.get(key)
        found = store.actions.entry(key)
        assert found is not None
        for file in found.files:
            assert other.blobs.get(file.digest) == store.blobs.get(file.digest)


def last_key(plan, store) -> str:
    result, _ = run(plan, store)
    return str(result.nodes["scene"].key)


@pytest.mark.parametrize("closure", ["targets", "full"])
def test_a_build_of_its_targets_runs_nothing(tmp_path, store, other, plan, closure):
    bundle(store, plan, closure).write(tmp_path / "bundle.tar")
    take(tmp_path / "bundle.tar", other)
    result, record = run(plan, other)
    assert result.ok
    assert record.with_status("ran") == []
    # The second build reads the state that the first one saved.
    assert run(plan, other)[1].with_status("ran") == []


def test_what_a_killed_attempt_left_goes(tmp_path, store, plan):
    torn = tmp_path / ".tmp-0123456789abcdef"
    torn.write_bytes(b"torn")
    os.utime(torn, (0, 0))
    bundle(store, plan).write(tmp_path / "bundle.tar")
    assert not torn.exists()


def test_bytes_that_come_later_make_a_bare_result_whole(tmp_path, store, other, plan, folder):
    bundle(store, plan).write(tmp_path / "targets.tar")
    bare = take(tmp_path / "targets.tar", other)
    assert bare.bare > 0
    run(plan, other)
    later = take(folder, other)
    assert (later.new, later.bare) == (later.new, 0)
    for key in store.actions.keys():  # noqa: SIM118 - not a mapping
        assert other.actions.get(key) == store.actions.get(key)


def test_what_was_bundled_bare_can_be_bundled_again(tmp_path, store, other, plan):
    bundle(store, plan).write(tmp_path / "one.tar")
    take(tmp_path / "one.tar", other)
    bundle(other, plan).write(tmp_path / "two.tar")
    assert (tmp_path / "two.tar").read_bytes() == (tmp_path / "one.tar").read_bytes()
    found = survey(plan, [Address(name) for name in plan.targets["default"]], other, "full")
    assert found.stale != ()


def test_taking_twice_changes_nothing(folder, other):
    first = take(folder, other)
    assert take(folder, other) == importer.Taken(0, 0, first.new, ())


def test_equal_targets_give_equal_bytes(tmp_path, store, plan):
    bundle(store, plan).write(tmp_path / "a.tar")
    run(plan, store)
    bundle(store, plan).write(tmp_path / "b.tar")
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


def test_the_store_keeps_what_it_has_under_a_key(folder, store, other):
    key = next(iter(store.actions.keys()))
    theirs = store.actions.get(key)
    output = other.blobs.put(canonical({"artifact": "Text", "fields": {"text": "mine"}}))
    document = other.blobs.put(store.blobs.get(key))
    mine = ActionResult(output, "mine", (), {}, 1.0, None, document)
    other.actions.put(key, mine)
    taken = take(folder, other)
    assert theirs.output != output
    assert len(taken.other) == 1
    assert other.actions.get(key) == mine


@pytest.mark.medium
def test_a_large_blob_is_never_in_memory(tmp_path, store, other):
    """96 MiB are imported while Python holds at most a tenth of that."""
    size = 96 << 20
    made = large(store, tmp_path / "large", size)
    tracemalloc.start()
    made.write(tmp_path / "large.tar")
    take(tmp_path / "large.tar", other)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert size in (found for _, found in other.blobs.all())
    assert peak < 10 << 20


def test_the_config_reads_what_it_spells(folder):
    opened = importer.open_bundle(layout.Layout(packed(folder)))
    assert Contents.read(opened.contents.spell()) == opened.contents
    source = layout.Layout(packed(folder))
    assert opened.manifest.spell() == source.whole(source.manifest(), "the manifest", 1 << 20)
