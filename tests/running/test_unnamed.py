"""Files that a rule opens though no input names them are named in a warning."""

from __future__ import annotations

from pathlib import Path

from dextera_build.running.runner import run_task

RULE = '''
"""toy.peek: opens files."""
import json
from pathlib import Path

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

HERE = Path(__file__).parent
TABLE = (HERE / "table.csv").read_text()


@rule(version=1, discovers=True)
def peek(ctx: Context) -> File:
    """Return what is in them."""
    (ctx.scratch / "own").write_text("x")
    (ctx.scratch / "own").read_text()
    (HERE.parents[1] / "written.txt").write_text("x")
    (HERE / "peek.py").read_text()
    json.loads((HERE.parents[1] / "data/seen.json").read_text())
    return File(data=ctx.read("data/asked.txt") + (HERE.parents[1] / "data/asked.txt").read_bytes())
'''


def test_files_that_no_input_names_are_named(tmp_path: Path) -> None:
    for name, text in {"rules/toy/peek.py": RULE.lstrip(), "rules/toy/table.csv": "1", "data/seen.json": "{}"}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "data/asked.txt").write_text("a")
    task = {"rule": "toy.peek", "backend": None, "options": {}, "inputs": {}, "project": str(tmp_path)}
    for _ in range(2):  # the second call finds the rule imported
        reply = run_task({**task, "store": str(tmp_path / "cache")}, lambda kind, data: None)
        named = "data/seen.json, rules/toy/table.csv"
        assert reply["line"] == f"warning: it opened {named}, which no input names: editing that makes nothing stale"
