"""A temporary project and the real `dxb` in it."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dextera_build.cli.main import main
from tests import documents
from tests.interrupts import hear_interrupts


def of_python() -> dict[str, str]:
    """Variables that Python reads when it starts."""
    return {name: value for name, value in os.environ.items() if name.startswith("PYTHON")}


STARTED_WITH = of_python()


READ_ONCE = ("PYTHON", "LC_", "LANG", "TZ", "TMPDIR", "OMP_", "MKL_", "DXB_FAILPOINT")
"""Beginnings of the names of variables that a process reads once."""


def is_read_by_commands(variable: str) -> bool:
    """Whether every command reads a variable anew, and not the process once."""
    return not variable.startswith(READ_ONCE)


@dataclass(frozen=True)
class Answer:
    """What one command did."""

    code: int
    out: str
    err: str

    @property
    def events(self) -> list[dict]:
        """The events of a build with `--console jsonl`."""
        return [json.loads(line) for line in self.err.splitlines() if line.startswith("{")]

    @property
    def document(self) -> dict[str, Any]:
        """What a verb printed with `--json`, compared with its description."""
        return documents.read(self.out)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The rows of the same."""
        return documents.rows(self.out)

    def nodes(self, *statuses: str) -> set[str]:
        """Addresses of nodes that ended with one of these statuses."""
        return {
            event["node"] for event in self.events if event["event"] == "node_finished" and event["status"] in statuses
        }


class Space:
    """A project folder that tests write into and run `dxb` in."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def write(self, name: str, text: str) -> Path:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def edit(self, name: str, old: str, new: str) -> None:
        text = (self.root / name).read_text()
        assert old in text, f"{old!r} is not in {name}"
        self.write(name, text.replace(old, new))

    def environment(self, **more: str) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if not name.startswith("DXB_")}
        return {
            **kept,
            "NO_COLOR": "1",
            "XDG_CONFIG_HOME": str(self.root / ".config"),
            "XDG_CACHE_HOME": str(self.root / ".cache"),
            # Waiting for the disk is tested by itself; elsewhere it would wait for what other tests write.
            "DXB_DURABLE": "0",
            **more,
        }

    def start(self, *words: str, **options: object) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "dextera_build", *words],
            cwd=self.root,
            env=self.environment(),
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=hear_interrupts(),
            **options,  # type: ignore[call-overload]
        )

    def dxb(self, *words: str, env: Mapping[str, str] | None = None, timeout_s: float = 300.0) -> Answer:
        """One command; in this process unless it needs another: Python takes longer to start than most commands."""
        if of_python() == STARTED_WITH and all(is_read_by_commands(name) for name in env or ()):
            return self._called(words, self.environment(**(env or {})))
        return self.run(*words, env=env, timeout_s=timeout_s)

    def _called(self, words: Sequence[str], environment: Mapping[str, str]) -> Answer:
        out, err = (
            io.TextIOWrapper(io.BytesIO(), "utf-8", errors, write_through=True)
            for errors in ("strict", "backslashreplace")
        )
        here, path, known = os.getcwd(), list(sys.path), dict(os.environ)
        try:
            os.chdir(self.root)
            os.environ.clear()
            os.environ.update(environment)
            sys.path.insert(0, str(self.root))  # as `python -m` does
            with redirect_stdout(out), redirect_stderr(err):
                try:
                    code = main(words)
                except SystemExit as leave:
                    code = int(leave.code or 0)
        finally:
            os.chdir(here)
            os.environ.clear()
            os.environ.update(known)
            sys.path[:] = path
        texts = [stream.buffer.getvalue().decode() for stream in (out, err)]  # type: ignore[attr-defined]
        return Answer(code, *texts)

    def run(self, *words: str, env: Mapping[str, str] | None = None, timeout_s: float = 300.0) -> Answer:
        """One command in a process of its own."""
        done = subprocess.run(
            [sys.executable, "-m", "dextera_build", *words],
            cwd=self.root,
            env=self.environment(**(env or {})),
            text=True,
            capture_output=True,
            timeout=timeout_s,
        )
        return Answer(done.returncode, done.stdout, done.stderr)

    def python(self, *words: str, env: Mapping[str, str] | None = None) -> Answer:
        """Run a Python program in the project."""
        done = subprocess.run(
            [sys.executable, *words],
            cwd=self.root,
            env=self.environment(**(env or {})),
            text=True,
            capture_output=True,
            timeout=300,
        )
        return Answer(done.returncode, done.stdout, done.stderr)

    def build(self, *words: str) -> Answer:
        """Build with a log of events."""
        return self.dxb("build", "--console", "jsonl", *words)
