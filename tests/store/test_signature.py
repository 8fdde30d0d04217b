"""What a build noted after it was read: if it may have changed in between, the build leaves no snapshot."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from dextera_build.store.signature import Watch


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A folder with folders."""
    (tmp_path / "there" / "inner").mkdir(parents=True)
    return tmp_path


def watch_began(folder: Path) -> Watch:
    """A watch that began a minute after everything in a folder was written."""
    watch = Watch()
    watch.started_ns = max(os.stat(path).st_ctime_ns for path in (folder, *folder.rglob("*"))) + 60 * 10**9
    return watch


def note(watch: Watch, folder: Path) -> bool:
    """Whether a folder and its entries are noted as settled."""
    for name in ("there/inner", "gone"):
        path = str(folder / name)
        if os.path.isdir(path):
            watch.folder(path)
        else:
            watch.file(path)
        watch.modules(path)
        watch.doubt(path)
    return watch.settled()


def test_what_was_at_rest_is_settled(old: Path) -> None:
    assert note(watch_began(old), old)


@pytest.mark.parametrize("change", ["a name", "a folder", "no folder"])
def test_what_changed_before_it_was_noted_is_not_settled(old: Path, change: str) -> None:
    watch = Watch()
    watch.started_ns -= 10**9
    if change == "a name":
        (old / "there/inner/new").touch()
    elif change == "a folder":
        (old / "gone").mkdir()
    else:
        shutil.rmtree(old / "there/inner")
    assert not note(watch, old)
