"""One project of small rules, and the command line in this process, where a fault shows as what it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.cli import main
from tests.e2e.space import Answer, Space
from tests.recipe.conftest import RECIPE, RULES

Dxb = Callable[..., Answer]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Space:
    # In a folder of its own: tests read all that is beside it.
    made = Space(tmp_path_factory.mktemp("hostile") / "project")
    made.write("dxb.toml", 'cache = "cache"\n')
    for name, text in RULES.items():
        made.write(f"rules/{name}", text.lstrip())
    made.write("recipes/say/words.yaml", RECIPE)
    return made


@pytest.fixture
def dxb(project: Space, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Dxb:
    """Runs one command in the project; an exception that is no error of dxb's fails the test with its traceback."""

    def fault(error: Exception, words: list[str]) -> int:
        raise error

    def run(*words: str) -> Answer:
        capsys.readouterr()
        code = main.main(words)
        said = capsys.readouterr()
        return Answer(code, said.out, said.err)

    monkeypatch.chdir(project.root)
    for name, value in project.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(main, "_fault", fault)
    return run


def one_error(answer: Answer, code: int = 2) -> str:
    """What a refused command printed: one error that a person can read, and nothing that steers a terminal."""
    assert (answer.code, answer.out) == (code, "")
    assert answer.err.count("error[DXB-") == 1
    assert len(answer.err) < 12_000
    assert all(c.isprintable() or c in "\n\t" for c in answer.err)
    return answer.err


def listing(folder: Path) -> dict[str, bytes]:
    """Every file below a folder with what it holds."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
