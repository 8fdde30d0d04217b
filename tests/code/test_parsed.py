"""Sources that an earlier command parsed: the same as those parsed now, and only of the same bytes."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.code import parsed, syntax
from dextera_build.code.loader import Library
from dextera_build.code.modules import PACKAGE
from dextera_build.code.parsed import Parsed
from dextera_build.store.state import State

ODD = b'''"""Odd."""
from . import one, two as three
__all__ = ["one", "\\ud800"]
if not TYPE_CHECKING:
    import far.away
one = 1
def f(x): return x
'''


REAL = syntax.source


@pytest.fixture
def state(tmp_path: Path) -> State:
    return State(str(tmp_path / "local" / "state.db"))


@pytest.fixture
def parses(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Files that are parsed."""
    files: list[str] = []

    def counted(data: bytes, file: str) -> syntax.Source:
        files.append(file)
        return REAL(data, file)

    monkeypatch.setattr(syntax, "source", counted)
    return files


def once(state: State, data: bytes, file: str = "odd.py") -> syntax.Source:
    """What a command of its own says of a source."""
    one = Parsed(state)
    found = one.source(data, file)
    one.save()
    return found


def test_a_source_is_parsed_once(state: State, parses: list[str]) -> None:
    sources = {file: file.read_bytes() for file in (PACKAGE / "code").glob("*.py")}
    for data, file in [(ODD, "odd.py"), *((data, str(file)) for file, data in sources.items())]:
        right = once(state, data, file)
        assert once(state, data, file) == right == REAL(data, file)
    assert len(parses) == len(sources) + 1


def test_other_bytes_are_parsed_again(state: State, parses: list[str]) -> None:
    first = once(state, ODD)
    assert once(state, ODD.replace(b"= 1", b"= 2")).definitions != first.definitions
    assert once(state, ODD) == first
    assert len(parses) == 3


def test_another_way_of_digesting_parses_again(
    state: State, parses: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    once(state, ODD)
    monkeypatch.setattr(parsed, "_form", lambda: "another")
    once(state, ODD)
    assert len(parses) == 2


@pytest.mark.parametrize("row", [b"", b"{", b"[]", b"3", b"\xff", b'["", {}]', b'["", []]'])
def test_a_malformed_row_is_parsed_again(state: State, parses: list[str], row: bytes) -> None:
    right = once(state, ODD)
    state.put("source", {"odd.py": row})
    assert once(state, ODD) == right
    assert len(parses) == 2


def test_a_second_command_parses_no_source(state: State, parses: list[str]) -> None:
    codes, counts = [], list[int]()
    for _ in range(2):
        library = Library()
        with library.code.kept_in(state):
            codes.append(library.code.of(library.find("factorize.mesh").file))
        counts.append(len(parses))
    assert codes[0] == codes[1]
    assert counts[0] == counts[1] > 0
