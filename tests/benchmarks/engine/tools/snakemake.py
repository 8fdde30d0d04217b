"""Snakemake."""

from __future__ import annotations

import os
from pathlib import Path

from tests.benchmarks.engine.dags import Dag, place
from tests.benchmarks.engine.tools.tool import PeerTool, shell_step, write_json

SNAKEFILE = """import json

with open("dag.json") as file:
    STEPS = {name: (inputs, number) for number, name, inputs, out in json.load(file)}
with open("sinks.json") as file:
    SINKS = json.load(file)

rule all:
    input: SINKS

rule step:
    input: lambda wildcards: STEPS[wildcards.name][0]
    output: "out/{name}"
    params: number=lambda wildcards: STEPS[wildcards.name][1]
    shell: "COMMAND"
"""


class Snakemake(PeerTool):
    """Snakemake with a shell rule."""

    name = "snakemake"
    step = "one `bash`"
    note = "checksums tell a touched leaf from a changed one; all that follows a node that ran, runs"

    def write(self, dag: Dag, folder: Path) -> None:
        import json

        write_json(dag, folder)
        (folder / "sinks.json").write_text(json.dumps([place(node) for node in dag.sinks]))
        command = shell_step("{input}", "{params.number}", "{output}")
        (folder / "Snakefile").write_text(SNAKEFILE.replace("COMMAND", command))

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "--quiet", "all", "--cores", str(len(os.sched_getaffinity(0)))]

    def environment(self, folder: Path) -> dict[str, str]:
        return {"XDG_CACHE_HOME": f"{folder}/.cache"}
