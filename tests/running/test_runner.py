"""The runner in this process: what a call that reads by itself tells, keeps and may not do."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from dextera_build.errors import DxbError, RuleError
from dextera_build.running.runner import run_task
from dextera_build.store.store import Store
from dextera_build.testing import RuleRunner

RULE = '''
"""toy.count: counts how often it was begun with these files."""
import os
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class CountOptions(Options):
    """Options."""
    do: str = "fail"
    """What to do in the end."""

@rule(version=1, discovers=True)
def count(ctx: Context, *, options: CountOptions) -> File:
    """Return how often."""
    names = ctx.glob("parts/*.txt")
    text = b"".join(ctx.read(name) for name in names)
    if options.do == "swallow":
        try:
            ctx.read("nothing.txt")
        except Exception:
            return File(data=b"as if nothing were")
    if options.do == "mask":
        os.umask(0o777)
        return File(data=b"masked")
    saved = ctx.keep / "count"
    before = saved.read_text() if saved.exists() else ""
    saved.write_text(before + "I")
    if options.do == "late":
        ctx.read("late.txt")
    ctx.check(options.do != "fail", "not yet", begun=before)
    return File(data=text + before.encode())
'''


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    (folder / "rules/toy").mkdir(parents=True)
    (folder / "rules/toy/count.py").write_text(RULE.lstrip())
    (folder / "parts").mkdir()
    (folder / "parts/a.txt").write_text("a")
    (folder / "late.txt").write_text("late")
    return folder


def go(project: Path, do: str, said: list[tuple[str, Mapping[str, object]]] | None = None) -> dict[str, Any]:
    task = {
        "rule": "toy.count",
        "backend": None,
        "options": {"do": do},
        "inputs": {},
        "store": str(project.parent / "store"),
        "project": str(project),
        "key": "ab" * 32,
    }
    return run_task(task, lambda kind, data: said.append((kind, data)) if said is not None else None)


def begun(project: Path) -> object:
    with pytest.raises(RuleError) as caught:
        go(project, "fail")
    return caught.value.facts["begun"]


def test_progress_is_found_again_only_by_a_call_that_read_the_same(project: Path) -> None:
    assert [begun(project), begun(project)] == ["", "I"]
    (project / "parts/a.txt").write_text("another")
    assert begun(project) == ""
    (project / "parts/a.txt").write_text("a")
    assert begun(project) == "II"
    (project / "parts/b.txt").write_text("b")
    assert begun(project) == ""


def test_what_it_asked_is_told_in_order(project: Path) -> None:
    reply = go(project, "work")
    assert [step[:2] for step in reply["reads"]] == [["names", "parts/*.txt"], ["file", "parts/a.txt"]]
    listing = Store(project.parent / "store").blobs.get(reply["reads"][0][2])
    assert listing == b'["parts/a.txt"]'


@pytest.mark.parametrize(("do", "code"), [("late", "DXB-B353"), ("swallow", "DXB-B352")])
def test_a_read_that_fails_fails_the_call(project: Path, do: str, code: str) -> None:
    said: list[tuple[str, Mapping[str, Any]]] = []
    with pytest.raises(DxbError) as caught:
        go(project, do, said)
    assert caught.value.code == code
    told = [step for kind, data in said if kind == "read" for step in data["steps"]]
    assert ["file", "parts/a.txt"] in [step[:2] for step in told]


def test_where_the_project_is_not_it_cannot_run(project: Path) -> None:
    rules = project / "rules"
    assert rules.is_dir()
    go(project, "work")  # the library is known from here on
    project.rename(project.parent / "elsewhere")
    with pytest.raises(DxbError) as caught:
        go(project, "work")
    assert caught.value.code == "DXB-E370"


def test_a_rule_is_tested_on_a_folder_of_its_own(project: Path, tmp_path: Path) -> None:
    files = tmp_path / "files"
    (files / "parts").mkdir(parents=True)
    (files / "parts/x.txt").write_text("x")
    runner = RuleRunner(tmp_path / "scratch", project, files=files)
    assert runner.run("toy.count", options={"do": "work"}).data == b"x"
    assert [name for _, name, _ in runner.reads] == ["parts/*.txt", "parts/x.txt"]


def test_a_result_can_be_read_whatever_mask_its_rule_set(project: Path) -> None:
    go(project, "mask")
    folders = [path for path in (project.parent / "store/cas").iterdir() if path.is_dir()]
    assert folders
    assert all(folder.stat().st_mode & 0o700 == 0o700 for folder in folders)


ORDER = '''
"""toy.order: the names of a mapping, in its order."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class OrderOptions(Options):
    """Options."""
    sizes: dict[str, int]
    """Sizes by name."""

@rule(version=1)
def order(ctx: Context, *, options: OrderOptions) -> File:
    """Return the names."""
    return File(data=" ".join(options.sizes).encode())
'''


def test_no_result_depends_on_the_order_of_a_mapping_because_no_key_does(project: Path) -> None:
    (project / "rules/toy/order.py").write_text(ORDER.lstrip())
    runner = RuleRunner(project.parent / "scratch", project)
    made = [runner.run("toy.order", options={"sizes": sizes}).data for sizes in ({"b": 1, "a": 2}, {"a": 2, "b": 1})]
    assert made == [b"a b", b"a b"]
