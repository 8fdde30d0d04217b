"""Verbs that only read: they make no store where its name is misspelled, and need none that can be written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.cli.main import main
from tests.e2e.space import Space

LEAF = """inputs: {text: words.txt}
nodes: {loud: {rule: toy.shout, text: $text}}
targets: {default: [loud]}
"""
READING = [
    "ls say/leaf --stale",
    "ls calls",
    "ls divergent",
    "ls runs",
    "show say/leaf",
    "why say/leaf:loud",
    "plan say/leaf",
    "plan say/leaf --check",
    "build say/leaf --check",
    "show --graph say/leaf --status -o graph.svg",
    "log",
    "diff say/leaf",
    "show --trace say/leaf",
    "report",
    "get say/leaf:loud",
    "check say/leaf:loud",
    "cache push say/leaf --to ./elsewhere",
    "bundle create say/leaf -o bundle.tar",
    "cache size",
    "cache gc",
    "cache gc --yes",
    "cache verify",
    "cache verify --repair",
]


@pytest.fixture
def here(space: Space, monkeypatch: pytest.MonkeyPatch) -> Space:
    """A project that reads a file; commands run in this process."""
    space.write("words.txt", "one two")
    space.write("recipes/say/leaf.yaml", LEAF)
    monkeypatch.chdir(space.root)
    for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(space.root / name))
    return space


@pytest.fixture
def sealed(here: Space) -> Iterator[Path]:
    """A store that was built in and may only be read, by whoever is not root."""
    assert here.dxb("build", "say/leaf").code == 0
    root = here.root / "cache"
    folders = [root, *(path for path in root.rglob("*") if path.is_dir())]
    for path in folders:
        path.chmod(0o555)
    yield root
    for path in folders:
        path.chmod(0o755)


@pytest.mark.parametrize("words", READING)
def test_a_verb_that_reads_makes_no_store(here: Space, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main([*words.split(), "--cache", "misspelled"])
    said = capsys.readouterr().err
    assert code in (0, 1, 2, 3)
    assert not (here.root / "misspelled").exists()
    assert "warning: there is no store at `misspelled` yet (from: command line)" in said


def test_a_plan_is_the_same_whether_there_is_a_store_or_not(here: Space, capsys: pytest.CaptureFixture[str]) -> None:
    plans = []
    for _ in range(2):
        assert main(["plan", "say/leaf", "--json"]) == 0
        plans.append(capsys.readouterr().out)
        (here.root / "cache").mkdir(exist_ok=True)
    assert plans[0] == plans[1]


@pytest.mark.medium
def test_an_edited_input_is_explained_from_a_store_that_may_only_be_read(
    sealed: Path, here: Space, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)  # root may write anything
    here.write("words.txt", "three")
    before = sorted(sealed.rglob("*"))
    assert main(["why", "say/leaf:loud"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("stale: 1 thing it depends on changed")
    assert "words.txt" in said
    assert main(["plan", "say/leaf", "--check"]) == 3
    assert sorted(sealed.rglob("*")) == before


@pytest.mark.medium
def test_a_report_that_cannot_be_written_says_where_it_could(here: Space, capsys: pytest.CaptureFixture[str]) -> None:
    assert here.dxb("build", "say/leaf").code == 0
    target = here.root / "cache" / "out" / "say" / "leaf" / "report.html"
    target.mkdir(parents=True)
    assert main(["report"]) == 2
    said = capsys.readouterr().err
    assert f"error[DXB-U177]: `{target}` cannot be written: Is a directory" in said
    assert "hint: dxb report say/leaf -o report.html" in said
