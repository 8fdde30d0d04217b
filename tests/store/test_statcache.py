"""Leaves: equal content gives equal digests, nothing is read twice, and no stale digest is used."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from dextera_build import digest
from dextera_build.artifacts.base import File, Folder
from dextera_build.errors import RecipeError
from dextera_build.store import signature
from dextera_build.store.blobs import Blobs
from dextera_build.store.signature import Watch
from dextera_build.store.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "capture"
    (root / "sub").mkdir(parents=True)
    (root / "rgb.png").write_bytes(b"pixels")
    (root / "sub" / "depth.png").write_bytes(b"depth")
    age(root / "rgb.png", root / "sub" / "depth.png")
    return root


def age(*paths: Path) -> None:
    """Make files look old; ctime cannot be set, so wait until its margin has passed."""
    for path in paths:
        os.utime(path, ns=(1_600_000_000_123_456_789, 1_600_000_000_123_456_789))
    time.sleep(0.03)


def count_reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    reads: list[str] = []
    real = Blobs.put_file

    def counted(self: Blobs, path: Path) -> tuple[str, int]:
        reads.append(path.name)
        return real(self, path)

    monkeypatch.setattr(Blobs, "put_file", counted)
    return reads


def test_a_file_is_a_file_artifact(store: Store, folder: Path) -> None:
    key = store.leaves.digest_leaf(folder / "rgb.png")
    assert File.decode(key, store.blobs.get).data == b"pixels"


def test_a_folder_is_a_folder_artifact(store: Store, folder: Path) -> None:
    for name in (".git", "__pycache__"):
        (folder / name).mkdir()
        (folder / name / "junk").write_text("junk")
    key = store.leaves.digest_leaf(folder)
    assert Folder.decode(key, store.blobs.get).files == {"rgb.png": b"pixels", "sub/depth.png": b"depth"}


def test_name_and_place_do_not_matter(store: Store, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "elsewhere" / "copy"
    other.parent.mkdir()
    before = store.leaves.digest_leaf(folder)
    os.rename(folder, other)
    assert store.leaves.digest_leaf(other) == before


def test_nothing_is_read_twice(store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reads = count_reads(monkeypatch)
    first = store.leaves.digest_leaf(folder)
    assert sorted(reads) == ["depth.png", "rgb.png"]
    assert store.leaves.digest_leaf(folder) == first
    store.leaves.save()
    again = Store(store.root)
    assert again.leaves.digest_leaf(folder) == first
    assert len(reads) == 2


def test_an_edit_is_seen_though_time_and_size_are_kept(store: Store, folder: Path) -> None:
    path = folder / "rgb.png"
    first = store.leaves.digest_leaf(path)
    before = path.stat()
    path.write_bytes(b"PIXELS")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    assert store.leaves.digest_leaf(path) != first


def test_a_file_written_just_now_is_read_again(store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second write within one clock tick leaves no trace, so fresh signatures are not trusted."""
    path = folder / "rgb.png"
    reads = count_reads(monkeypatch)
    path.write_bytes(b"first!")
    frozen = signature.of(os.stat(path))
    monkeypatch.setattr(signature, "of", lambda state: frozen)  # as if all writes happened within one tick
    first = store.leaves.digest_leaf(path)
    path.write_bytes(b"second")
    assert store.leaves.digest_leaf(path) != first
    assert len(reads) == 2


def test_a_file_whose_stamps_prove_nothing_is_read_again(
    store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stamps in a read-only image may be those of another version of it."""
    reads, path = count_reads(monkeypatch), folder / "rgb.png"
    monkeypatch.setattr(signature, "_devices", lambda: {path.stat().st_dev: False})
    first = store.leaves.digest_leaf(path)
    same = signature.of(path.stat())
    path.write_bytes(b"PIXELS")
    monkeypatch.setattr(signature, "of", lambda state: same)
    assert store.leaves.digest_leaf(path) != first
    assert len(reads) == 2


@pytest.mark.parametrize(
    ("mtime", "ago_ns", "racy"),
    [
        (1_000_000_000_000_000_001, 10_000_000, True),
        (1_000_000_000_000_000_001, 30_000_000, False),
        (1_000_000_000_000_000_000, 30_000_000, True),  # whole seconds: a coarse clock
        (1_000_000_000_000_000_000, 2_100_000_000, False),
    ],
)
def test_how_fresh_is_too_fresh(mtime: int, ago_ns: int, racy: bool) -> None:
    assert signature.is_racy((mtime, mtime, 1, 1), mtime + ago_ns) is racy


def test_a_blob_that_is_gone_is_put_back(store: Store, folder: Path) -> None:
    key = store.leaves.digest_leaf(folder / "rgb.png")
    store.blobs.path(digest.of_bytes(b"pixels")).unlink()
    store.blobs.path(key).unlink()
    assert store.leaves.digest_leaf(folder / "rgb.png") == key
    assert File.decode(key, store.blobs.get).data == b"pixels"


def test_links_count_as_what_they_lead_to(store: Store, folder: Path, tmp_path: Path) -> None:
    plain = store.leaves.digest_leaf(folder)
    (tmp_path / "linked").symlink_to(folder)
    assert store.leaves.digest_leaf(tmp_path / "linked") == plain
    (folder / "twin").symlink_to(folder / "sub")
    both = Folder.decode(store.leaves.digest_leaf(folder), store.blobs.get)
    assert both.files["twin/depth.png"] == b"depth"


def refused(store: Store, path: Path) -> RecipeError:
    with pytest.raises(RecipeError) as caught:
        store.leaves.digest_leaf(path)
    assert caught.value.hint
    return caught.value


def test_a_missing_file_is_named_with_what_is_near(store: Store, folder: Path) -> None:
    error = refused(store, folder / "sub" / "nope" / "x.png")
    assert error.code == "DXB-R301"
    assert error.message == f"there is no file or folder `{folder}/sub/nope/x.png`"
    assert error.hint == f"ls {folder}/sub"


def test_a_link_to_nothing_is_named(store: Store, folder: Path) -> None:
    (folder / "dangling").symlink_to("nowhere")
    error = refused(store, folder)
    assert error.message == f"`{folder}/dangling` is a link to `nowhere`, which is not there"


@pytest.mark.parametrize("target", [".", "loop", "../capture"])
def test_links_in_a_circle_are_refused(store: Store, folder: Path, target: str) -> None:
    (folder / "loop").symlink_to(target)
    error = refused(store, folder)
    assert error.code == "DXB-R303"
    assert error.message == f"`{folder}/loop` is a link that leads back to itself"


def test_what_is_no_file_is_refused(store: Store, folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "s"))
        error = refused(store, folder)
    assert error.message == f"`{folder}/s` is neither a file nor a folder"
    os.unlink(folder / "s")
    os.mkfifo(folder / "pipe")
    assert refused(store, folder / "pipe").code == "DXB-R303"


def test_a_file_that_the_system_makes_up_is_refused(store: Store, folder: Path) -> None:
    """Reading one may wait for ever, `/proc/kmsg` for example, and no stamp says that it changed."""
    (folder / "version").symlink_to("/proc/version")
    assert refused(store, folder).message == f"`{folder}/version` is neither a file nor a folder"
    (folder / "version").unlink()
    (folder / "empty").touch()
    assert File.decode(store.leaves.digest_leaf(folder / "empty"), store.blobs.get).data == b""


def test_an_unreadable_file_is_named(store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(self: Blobs, path: Path) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Blobs, "put_file", deny)
    error = refused(store, folder / "rgb.png")
    assert error.code == "DXB-R302"
    assert error.facts == {"system says": "Permission denied"}


def test_a_name_that_is_not_utf8_is_refused(store: Store, folder: Path) -> None:
    Path(os.fsdecode(os.fsencode(folder) + b"/caf\xe9.png")).write_bytes(b"x")
    error = refused(store, folder)
    assert error.code == "DXB-R305"
    assert error.message.endswith("caf\ufffd.png` is not UTF-8")


def test_a_file_that_keeps_changing_is_refused(store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "rgb.png"
    real = Blobs.put_file

    def restless(self: Blobs, source: Path) -> tuple[str, int]:
        found = real(self, source)
        source.write_bytes(os.urandom(8))
        return found

    monkeypatch.setattr(Blobs, "put_file", restless)
    assert refused(store, path).code == "DXB-R304"


def test_a_broken_table_is_forgotten(store: Store, folder: Path) -> None:
    key = store.leaves.digest_leaf(folder)
    for junk in (b"", b"{", b"[]", b"3", b"[1]", b"\xff"):
        store.leaves.save()
        store.state.put("leaf", dict.fromkeys(store.state.all("leaf"), junk))
        assert Store(store.root).leaves.digest_leaf(folder) == key


def test_what_was_looked_at_is_noted(store: Store, folder: Path) -> None:
    store.leaves.watch = watch = Watch()
    store.leaves.digest_leaf(folder)
    assert set(watch.files) == {str(folder / "rgb.png"), str(folder / "sub" / "depth.png")}
    assert watch.folders == {str(folder): ["rgb.png", "sub"], str(folder / "sub"): ["depth.png"]}
    store.leaves.watch = again = Watch()
    store.leaves.digest_leaf(folder)  # from the table
    assert again.files == watch.files
