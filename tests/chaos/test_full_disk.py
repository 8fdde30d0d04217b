"""A disk that fills up while a build records: one clear error, finished nodes kept, the next build goes on."""

from __future__ import annotations

import errno
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.building.export import Out
from dextera_build.engine.run import RunResult
from dextera_build.errors import StoreError
from dextera_build.project.project import Project
from dextera_build.running.runner import run_task
from dextera_build.runs.events import NodeFinished, NodeLog, NodeProgress
from dextera_build.runs.log import EventLog, read
from dextera_build.session import Session
from dextera_build.store import disk_full as disk
from dextera_build.store.store import Store
from tests.chaos.children import dxb
from tests.chaos.scenarios import PLAIN, assert_as_clean, project
from tests.e2e.space import Space
from tests.recipe.conftest import RULES

FILL = '''
"""toy.fill: writes much."""
import os
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class FillOptions(Options):
    """Options."""
    where: str = "store"
    """store, keep, scratch or library."""
    mib: int = 4
    """How much [MiB]."""

@rule(version=1)
def fill(ctx: Context, text: File, *, options: FillOptions) -> File:
    """Return much."""
    data = os.urandom(options.mib << 20)
    if options.where in ("keep", "scratch"):
        getattr(ctx, options.where).joinpath("much").write_bytes(data)
        return text
    if options.where == "library":
        try:
            ctx.keep.joinpath("much").write_bytes(data)
        except OSError:
            raise RuntimeError("[enforce fail] writer failed") from None
    return File(data=data)
'''
RECIPE = """nodes:
  start: {rule: toy.start}
  much: {rule: toy.fill, text: $start, where: %s}
  after: {rule: toy.shout, text: $much}
targets: {default: [after]}
"""


def mount(folder: Path, *flags: str) -> bool:
    command = ["mount", *flags, "-t", "tmpfs", "tmpfs", str(folder)]
    return subprocess.run(command, capture_output=True, text=True).returncode == 0


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A disk of 2 MiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    if os.geteuid() != 0 or not mount(folder, "-o", "size=2m"):
        pytest.skip("a small disk cannot be mounted here (needs root and mount(2)); the tests below inject ENOSPC")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path / "project")
    made.write("dxb.toml", 'cache = "cache"\n')
    for name, text in {**RULES, "toy/fill.py": FILL}.items():
        made.write(f"rules/{name}", text.lstrip())
    return made


def grow(folder: Path) -> None:
    assert mount(folder, "-o", "remount,size=64m")


def unfinished(store: Path) -> list[Path]:
    return [path for path in store.rglob(".tmp*/*") if path.is_file()]


@pytest.mark.parametrize(
    ("where", "code", "message"),
    [
        ("store", "S101", "the store is full"),
        ("keep", "S106", "the disk is full"),
        ("library", "S106", "the disk is full"),
    ],
)
def test_a_store_that_fills_up_fails_one_node_and_the_next_build_goes_on(space, small, where, code, message):
    space.write("recipes/say/much.yaml", RECIPE % where)
    answer = space.dxb("build", "--cache", str(small / "cache"), "say/much")
    assert answer.code == 1
    assert f"error[DXB-{code}]: much failed: {message}" in answer.err
    assert answer.err.count("error[") == 1
    assert re.search(r"free.* 0 MiB", answer.err)
    assert "No space left on device" in answer.err or where == "library"
    assert "hint: `dxb cache size`" in answer.err
    assert "`DXB_CACHE`" in answer.err
    assert "Traceback" not in answer.err
    assert unfinished(small) == []
    grow(small)
    again = space.build("--cache", str(small / "cache"), "say/much")
    assert again.code == 0, again.err
    assert again.nodes("cached") == {"start"}
    assert again.nodes("ran") == {"much", "after"}


@pytest.mark.slow
@pytest.mark.parametrize("kib", [8, 24, 48, 96, 160, 240, 320, 400, 480, 560, 800, 1600, 3500, 4200, 6400, 7200])
def test_wherever_a_small_disk_gets_full_the_next_build_is_as_a_clean_one(kib, tmp_path, small, clean):
    """Promise: whatever had no room, there is one error, and with room the build goes on."""
    made = project(tmp_path / "project")
    (made.root / "cache").symlink_to(small)
    assert mount(small, "-o", f"remount,size={kib}k")
    said = dxb(made.root, *PLAIN)
    assert said.code in (0, 1), said.text
    assert said.text.count("error[DXB-S10") == said.text.count("error[") == said.code, said.text
    assert "Traceback" not in said.text
    assert unfinished(small) == []
    grow(small)
    assert_as_clean(made, clean(made))


@pytest.mark.medium
def test_a_full_disk_for_temporary_files_names_tmpdir(space, small):
    space.write("recipes/say/much.yaml", RECIPE % "scratch")
    answer = space.dxb("build", "say/much", env={"TMPDIR": str(small)})
    assert answer.code == 1
    assert "error[DXB-S106]: much failed: the disk is full" in answer.err
    assert "`TMPDIR`" in answer.err
    assert space.build("say/much").nodes("cached") == {"start"}
    assert list(small.iterdir()) == []


def test_a_disk_without_any_room_is_one_error(space, small):
    space.write("recipes/say/much.yaml", RECIPE % "scratch")
    assert space.dxb("build", "--cache", str(small / "cache"), "say/much").code == 0
    with pytest.raises(OSError, match="No space left"):
        (small / "ballast").write_bytes(bytes(2 << 20))
    answer = space.dxb("build", "--cache", str(small / "cache"), "say/much", "--set", "after.times=3")
    assert answer.code == 1
    assert answer.err.count("error[") == 1
    assert "error[DXB-S101]" in answer.err
    (small / "ballast").unlink()
    assert space.dxb("build", "--cache", str(small / "cache"), "say/much", "--set", "after.times=3").code == 0


def full(*arguments: object) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "somewhere/much")


def task(space: Space, where: str) -> dict[str, object]:
    store = Store(space.root / "cache")
    options = {"where": where, "mib": 1}
    text = store.leaves.digest_leaf(space.write("text", "hello"))
    return {
        "rule": "toy.fill",
        "backend": None,
        "options": options,
        "inputs": {"text": text},
        "store": str(store.root),
        "project": str(space.root),
    }


@pytest.mark.parametrize("where", ["keep", "scratch"])
def test_what_a_rule_meets_is_explained(space, monkeypatch, capfd, where):
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StoreError, match="the disk is full") as caught:
        run_task(task(space, where), lambda kind, data: None)
    assert caught.value.code == "DXB-S106"
    assert caught.value.facts["file"] == "somewhere/much"
    assert caught.value.facts["it says"] == "[Errno 28] No space left on device: 'somewhere/much'"
    assert set(caught.value.facts) == {"file", "it says", "free in store", "free in scratch"}
    assert "Traceback" in capfd.readouterr().err  # for `dxb log`


def test_what_the_store_meets_is_explained(space, monkeypatch):
    given = task(space, "store")
    monkeypatch.setattr("dextera_build.store.files.write_all", full)
    with pytest.raises(StoreError, match="the store is full") as caught:
        run_task(given, lambda kind, data: None)
    assert caught.value.code == "DXB-S101"
    assert caught.value.hint is not None
    assert "DXB_CACHE" in caught.value.hint


def test_a_disk_that_is_full_when_targets_are_written_is_said(space, monkeypatch):
    monkeypatch.setattr(Out, "_restore", full)
    record = NodeFinished(1.0, "after", "toy.shout", None, "ran", "k", "o", 1.0)
    session = Session(Project(space.root), "say/much", makes=True)
    with pytest.raises(StoreError, match="the store is full") as caught:
        Out(session).place(RunResult(True, {"after": record}, ("after",)))
    assert caught.value.facts["file"] == "somewhere/much"


def test_only_a_full_disk_is_called_one(tmp_path, monkeypatch):
    def explained(error: BaseException) -> bool:
        return disk.explain(error, tmp_path, tmp_path) is not None

    wrapped = RuntimeError("cannot save")
    wrapped.__cause__ = OSError(errno.EDQUOT, "Disk quota exceeded")
    assert explained(wrapped)
    assert explained(RuntimeError("I/O error: No space left on device (os error 28)"))
    assert not explained(RuntimeError("writer failed"))
    assert not explained(OSError(errno.EACCES, "Permission denied"))
    monkeypatch.setattr(disk, "free_bytes", lambda path: 4096)
    assert explained(RuntimeError("writer failed"))
    assert explained(OSError("4096 requested and 0 written"))
    assert not explained(ZeroDivisionError("by hand"))


def test_the_error_names_the_disk_that_has_no_room(tmp_path, monkeypatch):
    store, scratch = tmp_path / "store", tmp_path / "scratch"
    monkeypatch.setattr(disk, "free_bytes", lambda path: 0 if path == scratch else 1 << 30)
    error = disk.explain(OSError(errno.ENOSPC, "No space left on device"), store, scratch)
    assert error is not None
    assert "`TMPDIR`" in str(error.hint)
    assert error.facts["free in store"] == f"1,024 MiB ({store})"
    inside = OSError(errno.ENOSPC, "No space left on device", str(store / "local" / "keep" / "much"))
    error = disk.explain(inside, store, scratch)
    assert error is not None
    assert "`DXB_CACHE`" in str(error.hint)


def test_an_event_without_room_is_left_out_and_the_log_stays_whole(tmp_path, monkeypatch):
    store = Store(tmp_path / "store")
    with EventLog(store) as log:
        log(NodeLog(1.0, "a", "first"))
        log.flush()
        write = os.write
        torn = iter([lambda d, data: write(d, data[:5]), full])
        monkeypatch.setattr(os, "write", lambda d, data: next(torn)(d, data))
        log(NodeLog(2.0, "a", "lost"))
        log.flush()
        monkeypatch.undo()
        log(NodeLog(3.0, "a", "last"))
        assert log.lost == 1
    assert [event["text"] for event in read(store, "0001")] == ["first", "last"]


def test_a_log_keeps_one_progress_event_a_second_and_the_last(tmp_path):
    store = Store(tmp_path / "store")
    with EventLog(store) as log:
        for step in range(101):
            log(NodeProgress(100.0 + step / 20, "a", step, 100, "steps"))
    assert [event["done"] for event in read(store, "0001")] == [0, 20, 40, 60, 80, 100]
