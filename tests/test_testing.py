"""`RuleRunner` and a worker's runner give a call the same folders: `scratch`, and `keep`."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.artifacts.base import File
from dextera_build.errors import RuleError
from dextera_build.rule import Context
from dextera_build.running.runner import run_task
from dextera_build.store.store import Store
from dextera_build.testing import RuleRunner

COUNT = '''
"""toy.count: says how often it was started."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class CountOptions(Options):
    """Options."""
    fails: int = 0
    """How often it fails first."""

@rule(version=1)
def count(ctx: Context, *, options: CountOptions) -> File:
    """Return where it keeps its progress."""
    starts = len(list(ctx.keep.iterdir())) + 1
    (ctx.keep / f"start_{starts}").touch()
    ctx.check(starts > options.fails, "not yet")
    ctx.say(f"start {starts}")
    return File(data=str(ctx.keep).encode())
'''


@pytest.fixture
def project(tmp_path: Path) -> Path:
    file = tmp_path / "project" / "rules" / "toy" / "count.py"
    file.parent.mkdir(parents=True)
    file.write_text(COUNT.lstrip())
    return tmp_path / "project"


def test_a_runner_keeps_what_a_failed_call_saved_and_drops_it_when_it_succeeds(project: Path, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path / "scratch", project)
    for _ in range(2):
        with pytest.raises(RuleError, match="not yet"):
            runner.run("toy.count", options={"fails": 2})
    assert runner.run("toy.count", options={"fails": 2}) == File(data=str(tmp_path / "scratch" / "keep").encode())
    assert runner.outcome.line == "start 3"
    runner.run("toy.count")
    assert runner.outcome.line == "start 1"


def test_a_runner_takes_a_folder_to_keep(project: Path, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "start_1").touch()
    runner = RuleRunner(tmp_path, project, keep=kept)
    runner.run("toy.count", options={"fails": 1})
    assert runner.outcome.line == "start 2"
    assert not kept.exists()


def test_a_context_makes_its_folder_when_it_is_asked_for(tmp_path: Path) -> None:
    ctx = Context(scratch=tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert ctx.keep == ctx.keep == tmp_path / "keep"
    assert list(ctx.keep.iterdir()) == []


def test_a_task_with_a_key_keeps_in_the_store_and_one_without_does_not(project: Path, tmp_path: Path) -> None:
    store = Store(tmp_path / "store")

    def place(**more: str) -> Path:
        task = {"rule": "toy.count", "backend": None, "options": {"fails": 0}, "inputs": {}}
        reply = run_task(task | more | {"store": str(store.root), "project": str(project)}, lambda kind, data: None)
        return Path(File.decode(reply["output"], store.blobs.get).data.decode())

    key = "5" * 64
    assert place(key=key) == store.keep.path(key)
    assert store.keep.path(key).is_dir()  # the engine drops it, after it has published the result
    assert not place().is_relative_to(store.root)
    assert not place().exists()
