"""What signatures prove, and paths noted after they were read.

If a path may have changed in between, or where the kernel does not set time stamps, the build leaves no snapshot.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from dextera_build.store import signature
from dextera_build.store.signature import Watch, modules


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A folder with a folder and a file."""
    (tmp_path / "there" / "inner").mkdir(parents=True)
    (tmp_path / "there" / "file").touch()
    return tmp_path


def watch_began(folder: Path) -> Watch:
    """A watch that started a minute after everything in a folder was written."""
    watch = Watch()
    watch.started_ns = max(os.stat(path).st_ctime_ns for path in (folder, *folder.rglob("*"))) + 60 * 10**9
    return watch


def note(watch: Watch, folder: Path) -> bool:
    """Whether two folders and a file, which all existed at first, are settled once noted."""
    for name in ("there", "there/inner", "there/file"):
        path = str(folder / name)
        if os.path.isdir(path):
            watch.folder(path)
        else:
            watch.file(path)
        watch.doubt(path, was_read=True)
    return watch.settled()


def test_what_was_at_rest_is_settled(old: Path) -> None:
    assert note(watch_began(old), old)


@pytest.mark.parametrize("change", ["a name", "a new file", "no file", "no folder"])
def test_what_changed_before_it_was_noted_is_not_settled(old: Path, change: str) -> None:
    watch = watch_began(old)
    watch.started_ns -= 60 * 10**9 - 1
    time.sleep(0.03)
    match change:
        case "a name":
            (old / "there/inner/new").touch()
        case "a new file":
            (old / "there/file").write_text("other")
        case "no file":
            (old / "there/file").unlink()
        case "no folder":
            shutil.rmtree(old / "there/inner")
    assert not note(watch, old)


def test_a_file_that_was_never_there_is_settled(old: Path) -> None:
    watch = watch_began(old)
    watch.file(old / "none")
    watch.doubt(str(old / "none"), was_read=False)
    assert watch.settled()


def test_only_names_that_can_be_imported_count_on_the_search_path(tmp_path: Path) -> None:
    for name in ("own", "dxb-build-x", "own.txt", "__pycache__"):
        (tmp_path / name).mkdir()
    for name in ("single.py", "native.so", "more.pth", ".pth"):
        (tmp_path / name).touch()
    assert modules(str(tmp_path)) == ["more.pth", "native.so", "own", "single.py"]


@pytest.fixture
def mounted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Say what kind of file system the temporary folder is on: the end of its line in `mountinfo`."""

    def mount(kind: str) -> None:
        device = os.stat(tmp_path).st_dev
        line = f"36 35 {os.major(device)}:{os.minor(device)} / {tmp_path} rw,relatime shared:1 - {kind}\n"
        (tmp_path / "mountinfo").write_text(f"22 27 0:21 / /proc rw - proc proc rw\n{line if kind else ''}")
        monkeypatch.setattr(signature, "_MOUNTS", str(tmp_path / "mountinfo"))
        signature._devices.cache_clear()

    yield mount
    signature._devices.cache_clear()


WHOLE = 10**9


@pytest.mark.parametrize(
    ("kind", "ctime", "proves"),
    [
        ("ext4 /dev/vda rw", 7 * WHOLE, True),  # such as Lustre, which has no fractions
        ("lustre 10.0.0.1@tcp:/data ro", 7 * WHOLE, True),  # changed by other clients, which set ctime
        ("squashfs /dev/loop0 ro,errors=continue", 7 * WHOLE, False),
        ("erofs /dev/loop0 ro", 7 * WHOLE + 1, False),  # ctime is mtime
        ("fuse.squashfuse squashfuse rw", 7 * WHOLE, False),
        ("fuse.gocryptfs /secret rw", 7 * WHOLE + 1, True),
        ("overlay overlay rw,lowerdir=/image", 7 * WHOLE, False),  # the lower layer may be squashfs
        ("overlay overlay rw,lowerdir=/image", 7 * WHOLE + 1, True),
        ("", 7 * WHOLE, False),  # a layer with a device of its own
        ("", 7 * WHOLE + 1, True),  # btrfs
    ],
)
def test_a_signature_proves_what_a_kernel_stamped(
    kind: str, ctime: int, proves: bool, mounted: Callable[[str], None], tmp_path: Path
) -> None:
    """An image that is replaced by its next version may have the same times, sizes and inodes."""
    mounted(kind)
    state = SimpleNamespace(st_mtime_ns=1, st_ctime_ns=ctime, st_size=1, st_ino=1, st_dev=os.stat(tmp_path).st_dev)
    assert signature.is_proof(signature.of(state), 60 * WHOLE) is proves  # type: ignore[arg-type]


def test_what_lies_on_a_read_only_medium_leaves_no_snapshot(mounted: Callable[[str], None], old: Path) -> None:
    mounted("squashfs /dev/loop0 ro")
    watch = watch_began(old)
    watch.started_ns += 60 * WHOLE
    watch.file(old / "there/file")
    assert not watch.settled()
