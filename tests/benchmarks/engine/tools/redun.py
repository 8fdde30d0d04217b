"""redun."""

from __future__ import annotations

import json
from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import PYTHON_STEP, PeerTool, write_json

WORKFLOW = f"""import filecmp
import json
import os
from typing import List

from redun import task
from redun.file import File

redun_namespace = "bench"
{PYTHON_STEP}

@task()
def node(inputs: List[File], number: int, out: str) -> File:
    made = out + ".new"
    step([file.path for file in inputs], number, made)
    if os.path.exists(out) and filecmp.cmp(made, out, shallow=False):
        os.unlink(made)
    else:
        os.rename(made, out)
    return File(out)

@task()
def main() -> list:
    with open("dag.json") as file:
        steps = json.load(file)
    with open("sinks.json") as file:
        sinks = set(json.load(file))
    made = {{}}
    for number, name, inputs, out in steps:
        made[out] = node([made[path] if path in made else File(path) for path in inputs], number, out)
    return [made[out] for out in made if out in sinks]
"""


class Redun(PeerTool):
    """redun with `File`, whose hash holds size and time."""

    name = "redun"
    step = "a function in a thread of its process"
    cutoff = True
    note = "a step leaves an unchanged output alone"

    def write(self, dag: Dag, folder: Path) -> None:
        write_json(dag, folder)
        (folder / "sinks.json").write_text(json.dumps([f"out/{node}" for node in dag.sinks]))
        (folder / "workflow.py").write_text(WORKFLOW)

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "run", "workflow.py", "main"]
