"""dxb."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from tests.benchmarks.engine.dags import FACTOR, PRIME, Dag, place
from tests.benchmarks.engine.tools.tool import Tool

RULE = f'''"""bench.step: as little work as a node can do."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, Options, rule


class StepOptions(Options):
    """Options of bench.step."""

    number: int
    """Makes nodes differ."""


@rule(version=1)
def step(ctx: Context, inputs: Collection[File], *, options: StepOptions) -> File:
    """Add the first lines of the inputs."""
    total = sum(int(file.data.split(b"\\n", 1)[0]) for file in inputs.items.values())
    return File(data=b"%d\\n" % ((total * {FACTOR} + options.number) % {PRIME}))
'''


class Dxb(Tool):
    """This project."""

    name = "dxb"
    step = "a rule in a worker process, result into the store"
    cutoff = True
    note = "outputs are those of the sinks; the store keeps all"

    def words(self) -> list[str]:
        return [str(Path(sys.executable).parent / "dxb")]

    def write(self, dag: Dag, folder: Path) -> None:
        (folder / "rules" / "bench").mkdir(parents=True)
        (folder / "rules" / "bench" / "step.py").write_text(RULE)
        (folder / "recipes").mkdir()
        leaves = "".join(f"  {name}: {place(name)}\n" for name in dag.leaves)
        calls = []
        for number, (node, inputs) in enumerate(dag.nodes.items()):
            parts = ", ".join(f"{label}: ${name}" for label, name in zip("abc", inputs, strict=False))
            calls.append(f"  {node}: {{rule: bench.step, inputs: {{{parts}}}, number: {number}}}\n")
        targets = ", ".join(dag.sinks)
        text = f"inputs:\n{leaves}nodes:\n{''.join(calls)}targets:\n  default: [{targets}]\n"
        (folder / "recipes" / "graph.yaml").write_text(text)
        (folder / "dxb.toml").write_text('cache = "cache"\n')

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "build", "graph", "--console", "none"]

    def environment(self, folder: Path) -> dict[str, str]:
        return {"XDG_CONFIG_HOME": f"{folder}/.config", "XDG_CACHE_HOME": f"{folder}/.cache"}

    def output(self, folder: Path, node: str) -> Path:
        return folder / "cache" / "out" / "graph" / node / node

    def outputs(self, folder: Path, dag: Dag) -> list[Path]:
        return [self.output(folder, node) for node in dag.sinks]

    def stamps(self, folder: Path, dag: Dag) -> object:
        return self._runs(folder)

    def ran(self, folder: Path, dag: Dag, before: object) -> int:
        runs = self._runs(folder)
        if runs == before:
            return 0
        assert isinstance(runs, list)
        with open(folder / "cache" / "runs" / runs[-1] / "events.jsonl") as file:
            last = next(event for event in reversed(list(file)) if '"run_finished"' in event)
        return int(json.loads(last)["counts"].get("ran", 0))

    def _runs(self, folder: Path) -> list[str]:
        runs = folder / "cache" / "runs"
        return sorted(os.listdir(runs)) if runs.exists() else []
