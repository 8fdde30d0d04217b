"""A program that code without a context keeps and asks, such as the policy of a trial."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from dextera_build.outside import messages
from dextera_build.outside.program import Program
from dextera_build.outside.running import Limits
from dextera_build.rule import outside

_LIMITS = Limits(timeout_s=600.0, memory_gb=0.0, disk_gb=16.0, idle_s=86_400.0)
"""Of one answer; the first may load a model."""


class StandingProgram:
    """A program that is started once, and asked until `end`; it answers as a server of docs/outside.md.

    Args:
        name: What it is called in messages: `the policy of learn.lerobot`.
        script: Its file, which Python of the environment runs.
        environment: Folder of its virtual environment, `.envs/lerobot`, in the project of the current folder.
        lock: File that lists the content of the environment, in that project.

    Raises:
        MachineError: The environment or the lock file is missing here.
    """

    def __init__(self, name: str, script: Path, environment: str, lock: str) -> None:
        here = Path.cwd()
        program = Program(
            backend=name,
            file=script,
            base=next((folder for folder in (here, *here.parents) if (folder / environment).exists()), here),
            command=("{python}", script.name),
            files=(),
            environment=f"venv:{environment}",
            lock=lock,
            server=True,
            limits=_LIMITS,
        )
        program.check(program.digests())
        self._name = name
        self._running = program.run({}, (), gpu=False)

    def ask(self, function: str, returns: Any, /, **inputs: object) -> Any:
        """The answer of a function of the program; see `Context.outside`.

        Raises:
            RuleError: It refused, failed, exceeded a limit, or answered in another form.
        """
        name = self._name
        folder = outside.exchanged(
            self._running, inputs, lambda kind, data: None, rule=name, backend=name, function=function
        )
        try:
            return outside.answered(folder / messages.RESPONSE, returns, name)[0]
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def end(self) -> None:
        """End it, with every process that it started."""
        self._running.end()
