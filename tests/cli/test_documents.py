"""The descriptions of JSON documents: every verb has its own, and no field changes without a new version."""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path

from dextera_build.cli import grammar, table
from dextera_build.cli.documents import DOCUMENTS
from dextera_build.cli.documents.document import Document
from tests import documents

CLI = Path(grammar.__file__).parent


def test_a_field_that_changes_raises_the_version() -> None:
    known, described = documents.recorded(), documents.described()
    lost = {
        f"{schema} {path}: {kind}"
        for schema in known.keys() & described.keys()
        for path, kind in known[schema].items()
        if described[schema].get(path) != kind
    }
    assert lost == set(), "raise `version` of the document"
    assert known == described, "`python -m tests.documents` records new fields, documents and versions"


def test_numbers_that_json_lacks_are_null() -> None:
    rows = [
        {"run": "0001", "time": 1.0, "recipe": "a", "ended": "done", "seconds": seconds}
        for seconds in (float("nan"), float("inf"), 1.5)
    ]
    assert [row["seconds"] for row in documents.rows(table.spelled("ls.runs", rows))] == [None, None, 1.5]


def test_a_comparison_finds_every_kind_of_difference() -> None:
    fields = {"a": ("integer", ""), "b[].c": ("text or null", ""), "d.*": ("number", ""), "e": ("text?", "")}
    document = Document("x", "dxb x", fields)
    assert documents.differences(document, {"a": 1, "b": [{"c": None}, {"c": "t"}], "d": {"x": 0.5}}) == []
    wrong = {"a": "1", "b": [{}, {"c": 2, "f": 0}], "d": {"x": None}, "e": "t"}
    assert documents.differences(document, wrong) == [
        "`a` is '1', not integer",
        "`b[].c` is missing",
        "`b[].c` is 2, not text",
        "`b[].f` is not described",
        "`d.*` is None, not number",
    ]


def test_every_verb_with_json_has_a_document_and_every_document_is_printed() -> None:
    commands = {document.command for document in DOCUMENTS.values()}
    asked = {command.partition(" [")[0] for command in with_json(grammar.parser(), "dxb")}
    assert [verb for verb in asked if not any(command.startswith(verb) for command in commands)] == []
    printed = {name for file in CLI.rglob("*.py") for name in names_in(ast.parse(file.read_text()))}
    made = {f"ls.{each}" for each in ("recipes", "rules", "backends", "profiles", "runs", "divergent", "calls")}
    made |= {"models.get", "models.add", "run", "robot.record"}
    assert printed | made == set(DOCUMENTS)


def with_json(parser: argparse.ArgumentParser, command: str) -> Iterator[str]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                yield from with_json(sub, f"{command} {name}")
        elif "--json" in action.option_strings:
            yield command


def names_in(tree: ast.Module) -> Iterator[str]:
    """Names of documents that calls of `give`, `say`, `spelled` and `check` state."""
    for node in ast.walk(tree):
        called = ast.unparse(node.func).rpartition(".")[2] if isinstance(node, ast.Call) and node.args else ""
        if called in ("give", "say", "spelled", "check") and isinstance(node.args[0], ast.Constant):
            yield str(node.args[0].value)
