"""GNU make."""

from __future__ import annotations

import os
from pathlib import Path

from tests.benchmarks.engine.dags import Dag, place
from tests.benchmarks.engine.tools.tool import Tool, shell_step


class Make(Tool):
    """GNU make."""

    name = "make"
    step = "one `sh`"
    note = "`-r`; compares time stamps"

    def write(self, dag: Dag, folder: Path) -> None:
        body = shell_step("IN", "NUMBER", "OUT").replace("$", "$$")
        body = body.replace("IN", "$^", 1).replace("NUMBER", "$1").replace("OUT", "$@")
        rules = [f"{out}: {' '.join(ins)}\n\t$(call step,{n})\n" for n, _, ins, out in dag.steps()]
        sinks = " ".join(map(place, dag.sinks))
        (folder / "Makefile").write_text(f"step = {body}\nall: {sinks}\n.PHONY: all\n" + "".join(rules))

    def command(self, folder: Path) -> list[str]:
        return ["make", "-rs", f"-j{len(os.sched_getaffinity(0))}"]
