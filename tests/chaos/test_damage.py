"""Blobs that are deleted or damaged, at any place and at any time: the build makes them again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.engine.graph import Graph
from dextera_build.engine.run import RunResult, build
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, every, graph, group, inline, item, leaf, out


def scene(photo: Path, end: int = 0) -> Graph:
    """A leaf, a group, a gathering, and nodes whose outputs refer to blobs."""
    return graph(
        call("seg", "items", {"box": "b", "mug": "m"}, photo=leaf(photo)),
        group("body", out("seg"), call("mesh", "blob", seen=item("body"))),
        call("join", "blob", all=every("body.mesh")),
        call("end", "blob", value=end, join=out("join"), seg=out("seg"), photo=leaf(photo), all=every("body.mesh")),
    )


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo"
    path.write_bytes(b"pixels")
    return path


def run(plan: Graph, root: Path) -> tuple[RunResult, Record]:
    record = Record()
    return build(plan, plan.targets["default"], store=Store(root), executor=inline(), listen=record), record


def blobs(root: Path) -> list[Path]:
    return sorted(path for path in (root / "cas").glob("??/*"))


def damage(path: Path, how: str) -> None:
    data = path.read_bytes()
    path.chmod(0o644)
    if how in ("deleted", "a folder"):
        path.unlink()
        if how == "a folder":
            (path / "within").mkdir(parents=True)
    elif how == "cut short":
        path.write_bytes(data[:-1])
    elif how == "empty":
        path.write_bytes(b"")
    else:
        path.write_bytes(bytes([data[0] ^ 1]) + data[1:])


@pytest.mark.medium
@pytest.mark.parametrize("how", ["deleted", "cut short", "empty", "flipped", "a folder"])
def test_any_damaged_blob_is_made_again_when_needed(tmp_path: Path, photo: Path, how: str) -> None:
    whole, _ = run(scene(photo), tmp_path / "store")
    count = len(blobs(tmp_path / "store"))
    for place in range(count):
        root = tmp_path / how / str(place)
        run(scene(photo), root)
        damage(blobs(root)[place], how)
        # Another `end` has to read everything that the damaged blob may be part of.
        result, _ = run(scene(photo, end=1), root)
        assert result.ok, (place, result.nodes)
        for name, node in result.nodes.items():
            if name != "end":
                assert node.output == whole.nodes[name].output
        again, record = run(scene(photo, end=1), root)
        assert again.ok
        assert record.with_status("ran") == []


@pytest.mark.parametrize("how", ["deleted", "flipped", "empty", "a folder"])
def test_all_blobs_damaged_at_once(tmp_path: Path, photo: Path, how: str) -> None:
    root = tmp_path / "store"
    first, _ = run(scene(photo), root)
    for path in blobs(root):
        damage(path, how)
    second, _ = run(scene(photo, end=1), root)
    assert second.ok
    assert second.nodes["join"].output == first.nodes["join"].output


def test_a_damaged_entry_is_a_miss(tmp_path: Path, photo: Path) -> None:
    root = tmp_path / "store"
    run(scene(photo), root)
    for number, path in enumerate(sorted((root / "ac").glob("??/*"))):
        path.chmod(0o644)
        data = path.read_bytes()
        path.write_bytes([b"", b"\xff" * 9, data[: len(data) // 2], data[:-3] + b"abc", b"not a message"][number])
    result, record = run(scene(photo), root)
    assert result.ok
    assert len(record.with_status("ran")) == 5


def test_entries_that_were_swapped_are_misses(tmp_path: Path, photo: Path) -> None:
    root = tmp_path / "store"
    first, _ = run(scene(photo), root)
    entries = sorted((root / "ac").glob("??/*"))
    contents = [path.read_bytes() for path in entries]
    for path, data in zip(entries, [*contents[1:], contents[0]], strict=True):
        damage(path, "deleted")
        path.write_bytes(data)
    result, record = run(scene(photo), root)
    assert {name: node.output for name, node in result.nodes.items()} == {
        name: node.output for name, node in first.nodes.items()
    }
    assert len(record.with_status("ran")) == 5


def test_a_folder_in_place_of_every_entry_is_set_aside(tmp_path: Path, photo: Path) -> None:
    root = tmp_path / "store"
    run(scene(photo), root)
    for path in sorted((root / "ac").glob("??/*")):
        damage(path, "a folder")
    assert len(run(scene(photo), root)[1].with_status("ran")) == 5
    assert run(scene(photo), root)[1].with_status("ran") == []


def test_what_cannot_be_made_again_fails_with_the_digest(tmp_path: Path, photo: Path) -> None:
    root = tmp_path / "store"
    first, _ = run(scene(photo), root)
    seg = first.nodes["seg"].output or ""

    class Losing(Record):
        """Deletes the output of `seg` whenever it was made."""

        def __call__(self, event: object) -> None:
            super().__call__(event)  # type: ignore[arg-type]
            if getattr(event, "node", "") == "seg" and type(event).__name__ == "NodeFinished":
                path = Store(root).blobs.path(seg)
                if path.exists():
                    os.unlink(path)

    record = Losing()
    result = build(scene(photo, end=1), [("end",)], store=Store(root), executor=inline(), listen=record)
    assert not result.ok
    error = next(iter(result.errors.values()))
    assert error.code == "DXB-S103"
    assert error.facts["digest"] == seg
    assert len(record.with_status("ran")) < 20  # it gave up


def test_a_quarantined_blob_can_be_looked_at(tmp_path: Path, photo: Path) -> None:
    root = tmp_path / "store"
    first, _ = run(scene(photo), root)
    store = Store(root)
    output = first.nodes["join"].output
    assert output is not None
    damage(store.blobs.path(output), "flipped")
    run(scene(photo, end=1), root)
    assert (root / "local" / "quarantine" / output).exists()
    assert store.blobs.has(output)
