"""SCons."""

from __future__ import annotations

import os
from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import PYTHON_STEP, PeerTool, write_json

SCONSTRUCT = f"""import json
{PYTHON_STEP}

def run(target, source, env):
    step([str(path) for path in source], int(env["NUMBER"]), str(target[0]))

env = Environment(tools=[])
env.Decider("content-timestamp")
action = Action(run, None, varlist=["NUMBER"])
with open("dag.json") as file:
    for number, name, inputs, out in json.load(file):
        env.Command(out, inputs, action, NUMBER=str(number))
"""


class SCons(PeerTool):
    """SCons with Python actions."""

    name = "scons"
    step = "a function in its process"
    cutoff = True
    clock_s = 1.0
    note = "`content-timestamp`; sees whole seconds of time stamps"

    def write(self, dag: Dag, folder: Path) -> None:
        write_json(dag, folder)
        (folder / "SConstruct").write_text(SCONSTRUCT)

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "-Qs", f"-j{len(os.sched_getaffinity(0))}"]
