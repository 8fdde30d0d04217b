"""A power cut: files that were not flushed are lost, short or hold zeros; that costs time, never a wrong result."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from dextera_build.engine.graph import Graph
from dextera_build.engine.run import RunResult, build
from dextera_build.gc.verify import verify
from dextera_build.runs import log as eventlog
from dextera_build.runs.events import fan_out
from dextera_build.runs.log import EventLog
from dextera_build.store import files as disk
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.headers import closure
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, every, graph, group, inline, item, leaf, out


def scene(photo: Path, value: int = 0) -> Graph:
    return graph(
        call("seg", "items", {"box": "b", "mug": "m"}, photo=leaf(photo)),
        group("body", out("seg"), call("mesh", "blob", value, seen=item("body"))),
        call("end", "blob", value, photo=leaf(photo), all=every("body.mesh")),
    )


def run(plan: Graph, root: Path) -> tuple[RunResult, Record]:
    """Build with a log, in a process that remembers nothing."""
    store, record = Store(root), Record()
    with EventLog(store) as log:
        listen = fan_out(log, record)
        return build(plan, plan.targets["default"], store=store, executor=inline(), listen=listen), record


def cut(path: Path, how: tuple[str, float]) -> None:
    """What is found of a file that was not flushed."""
    kind, share = how
    data = path.read_bytes()
    keep = int(len(data) * share)
    if kind == "lost":
        path.unlink()
        return
    path.chmod(0o644)
    if kind == "short":
        path.write_bytes(data[:keep])
    elif kind == "zeros":  # the size was written, the blocks were not
        path.write_bytes(data[:keep] + bytes(len(data) - keep))


def contents(root: Path) -> list[Path]:
    """Every file but the lock, which is empty."""
    return sorted(path for path in root.rglob("*") if path.is_file() and path.name != "locks")


def read_all(store: Store, plan: Graph, root: Path, header: str) -> dict[str, bytes]:
    """All bytes behind a header; what is missing is built again, each time a little more."""
    for _ in range(12):
        found, stack = {}, [header]
        try:
            while stack:
                name = stack.pop()
                found[name] = store.blobs.get(name)
                refs, blobs = closure(found[name])
                stack += refs
                found |= {blob: store.blobs.get(blob) for blob in blobs}
            return found
        except MissingBlob:
            assert run(plan, root)[0].ok
    raise AssertionError("building again does not help")


QUICK = (Phase.explicit, Phase.reuse, Phase.generate)
"""A failing case is said as it was found: each try is two builds, and shrinking would need thousands."""
HOW = st.tuples(st.sampled_from(["kept", "kept", "lost", "short", "zeros"]), st.sampled_from([0.0, 0.3, 0.5, 0.9]))


@pytest.mark.slow
@settings(max_examples=60, deadline=None, phases=QUICK)
@given(fate=st.lists(HOW, min_size=60, max_size=60))
def test_whatever_was_lost_the_next_build_is_right(fate: list[tuple[str, float]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root, photo = Path(folder) / "store", Path(folder) / "photo"
        photo.write_bytes(b"pixels")
        right, _ = run(scene(photo), root)
        header = right.nodes["end"].output or ""
        wanted = read_all(Store(root), scene(photo), root, header)
        for path, how in zip(contents(root), fate, strict=False):
            cut(path, how)
        again, _ = run(scene(photo), root)
        assert again.ok
        assert {name: node.output for name, node in again.nodes.items()} == {
            name: node.output for name, node in right.nodes.items()
        }
        assert read_all(Store(root), scene(photo), root, header) == wanted
        for log in eventlog.runs(Store(root)):
            eventlog.read(Store(root), log)  # a torn log can be read
        verify(Store(root), repair=True)
        assert run(scene(photo), root)[0].ok
        assert verify(Store(root)).is_whole


@pytest.mark.slow
@settings(max_examples=30, deadline=None, phases=QUICK)
@given(fate=st.lists(HOW, min_size=60, max_size=60))
def test_what_was_flushed_is_not_built_again(fate: list[tuple[str, float]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root, photo = Path(folder) / "store", Path(folder) / "photo"
        photo.write_bytes(b"pixels")
        run(scene(photo), root)
        flushed = {path: path.read_bytes() for path in contents(root)}
        run(scene(photo, value=1), root)
        # What was replaced since is lost in favour of neither: a rename leaves the old file or the new one.
        fresh = [path for path in contents(root) if path not in flushed]
        for path, how in zip(fresh, fate, strict=False):
            cut(path, how)
        _, record = run(scene(photo), root)
        assert record.with_status("ran") == []


@pytest.mark.slow
def test_every_prefix_of_every_file_is_survived(tmp_path: Path) -> None:
    photo = tmp_path / "photo"
    photo.write_bytes(b"pixels")
    right, _ = run(scene(photo), tmp_path / "store")
    files = contents(tmp_path / "store")
    for path in files:
        data = path.read_bytes()
        mode = path.stat().st_mode
        for length in range(0, len(data), max(1, len(data) // 8)):
            for found in (data[:length], data[:length] + bytes(len(data) - length)):
                replace(path, found)
                again, _ = run(scene(photo), tmp_path / "store")
                assert again.ok, (path, length)
                assert again.nodes["end"].output == right.nodes["end"].output
        replace(path, data)
        path.chmod(mode)


def replace(path: Path, data: bytes) -> None:
    """Put something in the place of a file, which a build may have set aside since."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


@pytest.mark.parametrize("with_syncfs", [True, False])
def test_settling_says_whether_it_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_syncfs: bool) -> None:
    if not with_syncfs:
        monkeypatch.setattr(disk, "_syncfs", lambda: None)
    assert disk.settle(str(tmp_path))
    assert disk.settle(str(tmp_path / "missing")) is not with_syncfs
