"""What the benchmark needs to know of a tool."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.engine.dags import FACTOR, PRIME, Dag

REPO = Path(__file__).parents[4]
PEERS = Path(os.environ.get("DXB_BENCH_PEERS") or REPO / ".venv" / "peers").absolute()
"""The environment with the peers from PyPI."""

PYTHON_STEP = f'''
def step(inputs, number, out):
    """What every node does."""
    total = 0
    for path in inputs:
        with open(path) as file:
            total += int(file.readline())
    with open(out, "w") as file:
        file.write(f"{{(total * {FACTOR} + number) % {PRIME}}}\\n")
'''


def shell_step(inputs: str, number: str, out: str) -> str:
    """What every node does, for `sh`: nothing but builtins, so one process."""
    add = f"s=0; for f in {inputs}; do read v < $f; s=$((s+v)); done"
    return f"{add}; echo $(((s*{FACTOR}+{number})%{PRIME})) > {out}"


class Tool:
    """One build tool."""

    name = ""
    step = ""
    """What carries out a node."""
    cutoff = False
    """Whether a step that runs again and writes the same bytes stops the wave."""
    clock_s = 0.02
    """Two time stamps that differ by less may look the same to it [s]."""
    note = ""
    """What else a reader of the table must know."""

    def words(self) -> list[str]:
        """The command without arguments."""
        return [self.name]

    def version(self) -> str:
        """Its version, or "" where the tool is absent."""
        return first_version([*self.words(), "--version"])

    def start(self) -> list[str]:
        """A command that does nothing."""
        return [*self.words(), "--help"]

    def write(self, dag: Dag, folder: Path) -> None:
        """Write what it needs beside the leaves and an empty folder `out`."""
        raise NotImplementedError

    def command(self, folder: Path) -> list[str]:
        """What builds everything."""
        return self.words()

    def environment(self, folder: Path) -> dict[str, str]:
        """Variables that it needs."""
        return {}

    def output(self, folder: Path, node: str) -> Path:
        """The file of a node that was built."""
        return folder / "out" / node

    def outputs(self, folder: Path, dag: Dag) -> list[Path]:
        """All files that it leaves for people to open."""
        return [self.output(folder, node) for node in dag.nodes]

    def delete(self, folder: Path, dag: Dag) -> None:
        """Delete the outputs and keep what the tool remembers."""
        for path in self.outputs(folder, dag):
            path.unlink(missing_ok=True)

    def stamps(self, folder: Path, dag: Dag) -> object:
        """Something from which `ran` can tell, after the next build, how many nodes ran."""
        return {path: _stamp(path) for path in self.outputs(folder, dag)}

    def ran(self, folder: Path, dag: Dag, before: object) -> int:
        """How many outputs were written since `before`."""
        assert isinstance(before, dict)
        return sum(_stamp(path) != stamp for path, stamp in before.items())

    def memory_mib(self, folder: Path) -> float:
        """Greatest memory of a server that outlives the command."""
        return 0.0

    def stop(self, folder: Path) -> None:
        """End what outlives the command."""


class PeerTool(Tool):
    """A tool from PyPI, in the environment of the peers."""

    def words(self) -> list[str]:
        return [str(PEERS / "bin" / self.name)]

    def version(self) -> str:
        script = f"from importlib import metadata; print(metadata.version('{self.name}'))"
        return first_version([str(PEERS / "bin" / "python"), "-c", script]) if Path(self.words()[0]).exists() else ""


def first_version(command: Sequence[str], env: dict[str, str] | None = None) -> str:
    """The first word with a digit that a command prints, or "" where there is no such command."""
    if shutil.which(command[0]) is None:
        return ""
    done = subprocess.run(command, capture_output=True, text=True, env=env)
    words = (done.stdout + done.stderr).replace(",", " ").split()
    return next((word.lstrip("v") for word in words if word.lstrip("v")[:1].isdigit()), "?")


def write_json(dag: Dag, folder: Path) -> None:
    """The graph for build files that are programs: [[number, name, inputs, output], ...]."""
    (folder / "dag.json").write_text(json.dumps(list(dag.steps())))


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_mtime_ns, found.st_ino
