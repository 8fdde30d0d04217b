"""Ninja."""

from __future__ import annotations

from pathlib import Path

from tests.benchmarks.engine.dags import FACTOR, PRIME, Dag
from tests.benchmarks.engine.tools.tool import Tool

# With `restat` an output that a step leaves alone counts as unchanged.
RULE = f"""rule step
  command = s=0; for f in $in; do read v < $$f; s=$$((s+v)); done; n=$$(((s*{FACTOR}+$number)%{PRIME})); $
    read o 2>/dev/null < $out; [ "$$o" = "$$n" ] || echo $$n > $out
  restat = 1
"""


class Ninja(Tool):
    """Ninja with `restat`."""

    name = "ninja"
    step = "one `sh`"
    cutoff = True
    note = "`restat = 1`: a step leaves an unchanged output alone"

    def start(self) -> list[str]:
        return ["ninja", "--version"]  # `--help` ends with 1

    def write(self, dag: Dag, folder: Path) -> None:
        edges = [f"build {out}: step {' '.join(ins)}\n  number = {n}\n" for n, _, ins, out in dag.steps()]
        (folder / "build.ninja").write_text(RULE + "".join(edges))

    def command(self, folder: Path) -> list[str]:
        return ["ninja", "--quiet"]
