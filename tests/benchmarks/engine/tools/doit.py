"""doit."""

from __future__ import annotations

from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import PYTHON_STEP, PeerTool, write_json

DODO = f"""import json
{PYTHON_STEP}

def task_step():
    with open("dag.json") as file:
        steps = json.load(file)
    for number, name, inputs, out in steps:
        yield {{"name": name, "actions": [(step, [inputs, number, out])], "file_dep": inputs, "targets": [out]}}
"""


class Doit(PeerTool):
    """doit with Python actions."""

    name = "doit"
    step = "a function in its process"
    cutoff = True

    def write(self, dag: Dag, folder: Path) -> None:
        write_json(dag, folder)
        (folder / "dodo.py").write_text(DODO)

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "run", "--reporter", "zero"]
