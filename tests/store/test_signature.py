"""Paths noted after they were read: if one may have changed in between, the build leaves no snapshot."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

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
