"""Projects and machines that share a store, with recipes of the same name: each has files and a past of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build import Project
from dextera_build.explain import runs
from dextera_build.runs import workspaces
from tests.e2e.space import Space


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Space, Space]:
    """Two projects whose rules differ."""
    found = []
    for name, end in (("ada", "!"), ("bob", "?")):
        made = Space(tmp_path / name)
        made.write("dxb.toml", f'cache = "{tmp_path}/store"\n')
        made.write("rules/toy/mark.py", MARK.replace("END", end))
        made.write("text", "hello")
        made.write(
            "recipes/g.yaml", "inputs: {t: text}\nnodes:\n  a: {rule: toy.mark, text: $t}\ntargets: {default: [a]}\n"
        )
        found.append(made)
    return found[0], found[1]


MARK = '''"""toy.mark: marks a text."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def mark(ctx: Context, text: File) -> File:
    """Add a mark."""
    return File(data=text.data + b"END")
'''


@pytest.mark.medium
def test_two_projects_in_one_store_never_see_the_files_of_one_another(pair: tuple[Space, Space]) -> None:
    paths = [Path(made.run("build", "g").out.strip().partition("\t")[2]) for made in pair]
    assert [path.read_text() for path in paths] == ["hello!", "hello?"]
    assert all("up to date" in made.run("build", "g").err for made in pair)
    projects = [Project.find(made.root) for made in pair]
    assert [project.get("g:a").data for project in projects] == [b"hello!", b"hello?"]
    assert [runs.find(project, None)[0] for project in projects] == ["0001", "0002"]


@pytest.mark.slow
def test_builds_at_once_in_two_projects_print_paths_that_keep_their_content(pair: tuple[Space, Space]) -> None:
    for turn in range(4):
        for made in pair:
            made.write("text", str(turn))
        running = [made.start("build", "g", "--console", "none") for made in (*pair, *pair)]
        printed = [process.communicate(timeout=300)[0].strip().partition("\t")[2] for process in running]
        assert [Path(path).read_text() for path in printed] == [f"{turn}!", f"{turn}?"] * 2


@pytest.mark.slow
def test_one_path_on_two_machines_is_two_projects(pair: tuple[Space, Space], as_machine: Callable[[str], None]) -> None:
    made = pair[0]
    placed = {}
    for name in ("one", "other"):
        as_machine(name)
        made.write("text", name)
        placed[name] = Project.find(made.root).build("g").paths["a"]
    for name, path in placed.items():
        as_machine(name)
        assert path.read_text() == f"{name}!"
        assert Project.find(made.root).get("g:a").data == f"{name}!".encode()


@pytest.fixture
def as_machine(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    return lambda name: monkeypatch.setattr(workspaces, "_machine", lambda: name)
