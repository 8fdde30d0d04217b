"""tup."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import Tool, shell_step


class Tup(Tool):
    """tup with `^o^`."""

    name = "tup"
    step = "one `sh` that sources a file, under FUSE"
    cutoff = True
    clock_s = 1.0
    note = "`^o^`: compares outputs; sees whole seconds of time stamps"

    def start(self) -> list[str]:
        return ["tup", "--version"]  # `--help` asks for a project

    def write(self, dag: Dag, folder: Path) -> None:
        # A Tupfile takes every `$(` for a variable, so the arithmetic stands in a file.
        (folder / "step.sh").write_text(shell_step("$*", "$number", "$out") + "\n")
        rules = [
            f": {' '.join(ins)} |> ^o^ set -- %f; number={n} out=%o; . ./step.sh |> {out}\n"
            for n, _, ins, out in dag.steps()
        ]
        (folder / "Tupfile").write_text("".join(rules))
        subprocess.run(["tup", "init"], cwd=folder, check=True, capture_output=True)

    def command(self, folder: Path) -> list[str]:
        return ["tup", "--quiet"]
