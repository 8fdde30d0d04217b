"""The page of promises: every promise names a test that shows it, and every test that is named exists."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

REPO = Path(__file__).parent.parent
PAGE = REPO / "dextera_build" / "docs" / "promises.md"
NAMED = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def promises(text: str) -> list[str]:
    """The items of the page's lists, each as one text."""
    return [item.strip() for item in re.findall(r"^- .*?(?=^- |^#|^$|\Z)", text, re.DOTALL | re.MULTILINE)]


@cache
def names_in(file: Path) -> frozenset[str]:
    """Names of the test functions of a file, those of classes too."""
    nodes = ast.walk(ast.parse(file.read_text())) if file.is_file() else ()
    return frozenset(node.name for node in nodes if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"))


ITEMS = promises(PAGE.read_text())


def test_the_page_has_promises():
    assert len(ITEMS) > 40
    assert len(set(ITEMS)) == len(ITEMS)


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item[2:60])
def test_a_promise_names_tests_that_exist(item):
    named = NAMED.findall(item)
    assert named, "no test shows this"
    assert [f"{file}::{name}" for file, name in named if name not in names_in(REPO / file)] == []


def test_nothing_else_on_the_page_looks_like_a_test():
    """A name that is spelled wrongly would be passed over."""
    text = PAGE.read_text()
    assert text.count("::") == len(NAMED.findall(text))


def test_a_promise_without_a_test_is_found():
    assert promises("## A\n\n- one\n  `x`\n- two\n\ntext\n") == ["- one\n  `x`", "- two"]
    assert not NAMED.findall("- one `tests/x.py`")
