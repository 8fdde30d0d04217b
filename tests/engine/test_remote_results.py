"""Nodes that are fetched rather than run, results that are uploaded, and remotes that fail: a build never does."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import pytest

from dextera_build.engine.graph import Graph
from dextera_build.engine.run import RunResult
from dextera_build.remotes.breaker import Guarded
from dextera_build.remotes.exchange import Exchange
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.runs.events import NodeFinished, RemoteGivenUp, RunFinished, Uploaded
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, out, run, scene


def build(plan: Graph, store: Store, *remotes: Guarded, **flags: object) -> tuple[RunResult, Record]:
    return run(plan, store, exchange=Exchange(store, remotes), **flags)


def guarded(remote: Remote, mode: str = "rw", timeout_s: float = 5.0) -> Guarded:
    return Guarded("lab", remote.address, lambda: remote, mode=mode, timeout_s=timeout_s)


@pytest.fixture
def share(tmp_path: Path) -> Path:
    return tmp_path / "share"


@pytest.fixture
def other(tmp_path: Path) -> Store:
    return Store(tmp_path / "other")


def outputs(result: RunResult) -> dict[str, str | None]:
    return {address: record.output for address, record in result.nodes.items()}


def test_what_one_store_built_another_fetches_and_runs_nothing(store: Store, other: Store, share: Path) -> None:
    made, record = build(scene(), store, guarded(Directory(share)))
    assert len(record.with_status("ran")) == 6
    (sent,) = record.of(Uploaded)
    assert (sent.results, sent.left) == (6, 0)
    got, record = build(scene(), other, guarded(Directory(share), "r"))
    assert got.ok
    assert set(record.with_status("fetched")) == set(made.nodes)
    assert record.with_status("ran") == []
    assert outputs(got) == outputs(made)
    for key in (node.key for node in made.nodes.values()):
        assert key is not None
        assert other.actions.entry(key) == store.actions.entry(key)
    assert {event.remote for event in record.of(NodeFinished)} == {"lab"}
    assert record.of(RunFinished)[0].counts == {"fetched": 6}


def test_what_was_fetched_is_cached_the_next_time(store: Store, other: Store, share: Path) -> None:
    build(scene(), store, guarded(Directory(share)))
    build(scene(), other, guarded(Directory(share), "r"))
    _, record = run(scene(), other)
    assert len(record.with_status("cached")) == 6


def test_a_remote_to_read_is_not_written_and_the_other_way_round(store: Store, share: Path) -> None:
    build(scene(), store, guarded(Directory(share), "r"))
    assert not share.exists()
    build(scene(mesh=1), store, guarded(Directory(share), "w"))
    assert share.exists()
    _, record = build(scene(mesh=1), Store(share.parent / "fresh"), guarded(Directory(share), "w"))
    assert record.with_status("fetched") == []


def test_what_is_forced_runs(store: Store, other: Store, share: Path) -> None:
    plan = graph(call("a"), call("b", x=out("a")))
    build(plan, store, guarded(Directory(share)))
    _, record = build(plan, other, guarded(Directory(share)), force=frozenset({"b"}))
    assert record.with_status("fetched") == ["a"]
    assert record.with_status("ran") == ["b"]


class Counting(Directory):
    """Notes which keys were asked for."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.asked: list[str] = []

    def get_entry(self, key: str) -> bytes | None:
        self.asked.append(key)
        return super().get_entry(key)


def test_two_nodes_with_one_key_fetch_once(store: Store, other: Store, share: Path) -> None:
    # Equal options give equal keys: the tiny rule has its name among them.
    twins = [call("left", "const", 1), call("right", "const", 1)]
    twins = [replace(twin, options={**twin.options, "name": "same"}) for twin in twins]
    plan = graph(*twins, call("both", l=out("left"), r=out("right")))
    build(plan, store, guarded(Directory(share)))
    remote = Counting(share)
    got, record = build(plan, other, guarded(remote))
    assert got.ok
    assert len(remote.asked) == len(set(remote.asked)) == 2
    assert len(record.with_status("fetched")) == 2
    assert len(record.with_status("cached")) == 1


class Broken(Directory):
    """Fails as it is told; counts how often it was asked."""

    def __init__(self, root: Path, fail: Callable[[str], None]) -> None:
        super().__init__(root)
        self.calls: list[str] = []
        self._fail = fail

    def _note(self, what: str) -> None:
        self.calls.append(what)
        self._fail(what)

    def get_entry(self, key: Digest) -> bytes | None:
        self._note("get")
        return super().get_entry(key)

    def fetch(self, digest: Digest, take: Callable[[Iterator[bytes]], bool]) -> bool | None:
        self._note("fetch")
        return super().fetch(digest, take)

    def has(self, digest: Digest) -> bool:
        self._note("has")
        return super().has(digest)

    def send(self, digest: Digest, file: BinaryIO) -> None:
        self._note("send")
        super().send(digest, file)

    def put_entry(self, key: Digest, message: bytes) -> None:
        self._note("put")
        super().put_entry(key, message)


def wide(number: int = 30) -> Graph:
    names = [f"n{place}" for place in range(number)]
    return graph(*(call(name) for name in names), call("last", **{name: out(name) for name in names}))


def test_a_remote_that_always_fails_is_left_alone_after_a_few_tries(store: Store, share: Path) -> None:
    def fail(what: str) -> None:
        raise RemoteFault("lab", "no connection")

    remote = Broken(share, fail)
    result, record = build(wide(100), store, guarded(remote))
    assert result.ok
    assert len(record.with_status("ran")) == 101
    (notice,) = record.of(RemoteGivenUp)
    assert (notice.remote, notice.doing, notice.reason) == ("lab", "both", "no connection")
    assert len(remote.calls) < 40
    (sent,) = record.of(Uploaded)
    assert (sent.results, sent.left, sent.reason) == (0, 101, "no connection")


def test_one_fault_now_and_then_costs_nothing_but_a_second_try(store: Store, other: Store, share: Path) -> None:
    build(graph(call("a"), call("b", x=out("a")), call("c", x=out("b"))), store, guarded(Directory(share)))
    turns = iter([True, False, False, False, False] * 20)

    def fail(what: str) -> None:
        if next(turns):
            raise RemoteFault("lab", "a hiccup")

    plan = graph(call("a"), call("b", x=out("a")), call("c", x=out("b")))
    result, record = build(plan, other, guarded(Broken(share, fail), "r"))
    assert result.ok
    assert record.with_status("fetched") == ["a", "b", "c"]
    assert record.of(RemoteGivenUp) == []


def test_a_remote_that_takes_nothing_still_gives(store: Store, other: Store, share: Path) -> None:
    build(wide(), store, guarded(Directory(share)))

    def fail(what: str) -> None:
        if what in ("has", "send", "put"):
            raise RemoteFault("lab", "PUT was answered 403", refused=True)

    names = [f"n{place}" for place in range(30)]
    more = graph(
        *(call(name) for name in names), call("new", value=7), call("last", **{n: out(n) for n in [*names, "new"]})
    )
    result, record = build(more, other, guarded(Broken(share, fail)))
    assert result.ok
    assert len(record.with_status("fetched")) == 30
    assert set(record.with_status("ran")) == {"new", "last"}
    (notice,) = record.of(RemoteGivenUp)
    assert notice.doing == "write"
    assert record.of(Uploaded)[0].left == 2


class PanicError(BaseException):
    """As a library in Rust raises it: beside `Exception`."""


@pytest.mark.parametrize("kind", [ZeroDivisionError, PanicError])
def test_a_remote_that_raises_anything_fails_no_build(store: Store, share: Path, kind: type[BaseException]) -> None:
    def fail(what: str) -> None:
        raise kind("a fault of a library")

    result, record = build(scene(), store, guarded(Broken(share, fail)))
    assert result.ok
    assert kind.__name__ in record.of(RemoteGivenUp)[0].reason


@pytest.mark.medium
def test_a_remote_that_takes_long_to_load_is_not_slow(store: Store, other: Store, share: Path) -> None:
    build(scene(), store, guarded(Directory(share)))

    def load() -> Directory:
        time.sleep(1.8)
        return Directory(share)

    _, record = build(scene(), other, Guarded("lab", "share", load, mode="r", timeout_s=0.5))
    assert record.of(RemoteGivenUp) == []
    assert len(record.with_status("fetched")) == 6


@pytest.mark.parametrize("where", ["get", "fetch", "send"])
def test_a_remote_that_hangs_is_left_alone(store: Store, other: Store, share: Path, where: str) -> None:
    build(scene(), store, guarded(Directory(share)))
    forever = threading.Event()

    def fail(what: str) -> None:
        if what == where:
            forever.wait()

    began = time.monotonic()
    result, record = build(scene(mesh=3), other, guarded(Broken(share, fail), timeout_s=0.1))
    assert result.ok
    assert time.monotonic() - began < 60
    assert record.of(RemoteGivenUp)[0].reason == "it answers too slowly"


@pytest.mark.parametrize("seed", range(6))
def test_damage_in_the_remote_never_reaches_a_build(tmp_path: Path, seed: int) -> None:
    dice = random.Random(seed)
    share, store = tmp_path / "share", Store(tmp_path / "store")
    made, _ = build(scene(), store, guarded(Directory(share)))
    for file in sorted(path for path in share.rglob("*") if path.is_file()):
        data = bytearray(file.read_bytes())
        file.unlink()
        harm = dice.choice(("cut", "flip", "lose", "keep", "grow", "empty"))
        if harm == "flip":
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        elif harm == "cut":
            del data[dice.randrange(len(data)) :]
        elif harm == "grow":
            data += b"x" * dice.randrange(1, 5000)
        elif harm == "empty":
            data.clear()
        if harm != "lose":
            file.write_bytes(bytes(data))
    other = Store(tmp_path / "other")
    got, record = build(scene(), other, guarded(Directory(share)))
    assert got.ok
    assert outputs(got) == outputs(made)
    assert all(other.blobs.verify(digest) for digest, _ in other.blobs.all())
    # What was found to be damaged was sent again, so a third machine gets more than the second.
    third, later = build(scene(), Store(tmp_path / "third"), guarded(Directory(share)))
    assert outputs(third) == outputs(made)
    assert len(later.with_status("fetched")) >= len(record.with_status("fetched"))


def test_a_run_that_fails_uploads_what_was_made(store: Store, other: Store, share: Path) -> None:
    plan = graph(call("a"), call("b", "fail", x=out("a")), call("c", x=out("b")))
    result, record = build(plan, store, guarded(Directory(share)))
    assert not result.ok
    assert record.of(Uploaded)[0].results == 1
    _, record = build(plan, other, guarded(Directory(share)))
    assert record.with_status("fetched") == ["a"]


def test_remotes_are_asked_in_their_order(store: Store, other: Store, tmp_path: Path) -> None:
    build(graph(call("a")), store, guarded(Directory(tmp_path / "second")))
    first, second = guarded(Directory(tmp_path / "first")), guarded(Directory(tmp_path / "second"))
    first.name, second.name = "first", "second"
    _, record = build(graph(call("a")), other, first, second)
    assert [event.remote for event in record.of(NodeFinished)] == ["second"]
