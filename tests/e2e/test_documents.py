"""Every verb with `--json` prints one document, as described; those of servers and robots are compared in their tests."""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.cli import documents as described
from dextera_build.cli import grammar, table
from dextera_build.cli.documents.document import Document
from tests import documents
from tests.e2e.conftest import Space

CLI = Path(grammar.__file__).parent
READING = """
ls | ls rules | ls backends | ls profiles | ls runs | ls divergent | ls calls | ls say/words
plan say/words | plan say/words --check | why say/words | why say/words:all | check say/words | check say/words:all
show say/words | show say/words:all | show toy.shout | show factorize.mesh | show --config
show --graph say/words | show --graph say/words --dot | show --graph say/words -o graph.json
show --lineage say/words | show --trace | show --trace -o trace.json
diff 0001:start 0001:words | log | log 0001 start | get say/words:all -o got | library | report -o page.html
cache size | cache gc | cache verify | cache push say/words --to ./elsewhere | cache pull say/words --from ./elsewhere
bundle create say/words -o words.tar | bundle inspect words.tar | bundle inspect words.tar --recipe say/words
bundle import words.tar | bundle keygen anna
models ls | models verify | consent ls | doctor
"""
ELSEWHERE = {
    *("bind", "bind.removed", "cache.serve", "check.calibration", "library.folder", "run", "serve", "show.call"),
    *("models.accept", "models.add", "models.get", "models.rm", "robot.doctor", "robot.record", "robot.simulate"),
    *("show.part", "teleop", "teleop.ended", "view", "view.file"),
}
"""Documents that the tests of their verbs compare, on a service, a server, a robot, weights or shapes."""


@pytest.mark.medium
def test_verbs_print_the_documents_that_are_described(space: Space) -> None:
    assert space.build("say/words").code == 0
    seen = set()
    for words in (line.strip() for line in READING.replace("\n", "|").split("|") if line.strip()):
        answer = space.dxb(*words.split(), "--json")
        assert answer.code in ((0, 4) if words == "doctor" else (0,)), answer.err
        seen.add(documents.read(answer.out)["schema"])
    assert seen == {each.schema for name, each in described.DOCUMENTS.items() if name not in ELSEWHERE}


@pytest.mark.medium
def test_what_goes_wrong_is_described_too(space: Space) -> None:
    space.write("recipes/say/wrong.yaml", "nodes:\n  a: {rule: toy.shuot, text: x}\n")
    one = space.dxb("check", "say/wrong", "--json")
    (row,) = one.rows
    assert (one.code, row["found"], row["error"]["where"][1]) == (2, None, 2)
    assert "error[DXB-R" in one.err
    assert space.dxb("check", "--json").rows[-1] == row
    assert space.dxb("plan", "say/nothing", "--json").out == ""
    unbuilt = space.dxb("plan", "say/words", "--check", "--json")
    assert (unbuilt.code, unbuilt.rows) == (3, [{"node": "start", "why": "never built"}])
    nothing = {name: row[name] for row in space.dxb("ls", "say/words", "--json").rows[:1] for name in row}
    assert (nothing["backend"], nothing["last_seconds"]) == (None, None)


def test_numbers_that_json_lacks_are_null() -> None:
    told = documents.every(table.spelled("ls.nodes", [])) + [
        {"rows": row} for row in documents.rows(table.spelled("ls.runs", [run(float("nan")), run(1.5)]))
    ]
    assert [each["rows"]["seconds"] for each in told[1:]] == [None, 1.5]


def run(seconds: float) -> dict[str, object]:
    return {"run": "0001", "time": 1.0, "recipe": "a", "ended": "done", "seconds": seconds}


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
    commands = {document.command.split(",")[0] for document in described.DOCUMENTS.values()}
    asked = {command.partition(" [")[0] for command in with_json(grammar.parser(), "dxb")}
    assert [verb for verb in asked if not any(command.startswith(verb) for command in commands)] == []
    printed = {name for file in CLI.rglob("*.py") for name in names_in(ast.parse(file.read_text()))}
    made = {f"ls.{each}" for each in ("recipes", "rules", "backends", "profiles", "runs", "divergent", "calls")}
    made |= {"models.get", "models.add", "run", "robot.record"}
    assert printed | made == set(described.DOCUMENTS)


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
        if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            if ast.unparse(node.func).rpartition(".")[2] in ("give", "say", "spelled", "check"):
                yield str(node.args[0].value)
