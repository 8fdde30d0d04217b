"""What one cold process costs: wall time, processor time, greatest memory, exit code."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

LAUNCH = Path(__file__).with_name("launch.py")


@dataclass(frozen=True)
class Cost:
    """What a command cost."""

    code: int
    late: bool
    """Whether it was killed because its time was over."""
    seconds: float
    cpu: float
    """Processor time of the process and all that it waited for [s]."""
    rss_mib: float
    """Greatest resident memory of one of these processes [MiB]; not below that of the bare Python that starts them."""
    log: str = ""
    """The end of what it printed."""

    @property
    def ok(self) -> bool:
        """Whether it ended in time and well."""
        return not self.late and self.code == 0

    @property
    def why(self) -> str:
        """In what way it did not end well."""
        if self.late:
            return "took too long"
        if self.code < 0:
            return f"ended by {signal.Signals(-self.code).name}"
        last = next((line.strip() for line in reversed(self.log.splitlines()) if line.strip()), "")
        return f"exit code {self.code}: {last}"


def environment(**more: str) -> dict[str, str]:
    """The environment without settings of dxb, and without the one that has Python compile anew what it loads."""
    told = ("DXB_", "PYTHONDONTWRITEBYTECODE")
    return {**{name: value for name, value in os.environ.items() if not name.startswith(told)}, **more}


def cost(command: Sequence[str], folder: Path, limit: float, env: Mapping[str, str] | None = None) -> Cost:
    """Run a command in `folder` and say what it cost."""
    with tempfile.NamedTemporaryFile(prefix="dxb-bench-", suffix=".log") as log:
        words = [sys.executable, "-I", "-S", str(LAUNCH), str(limit), log.name, *command]
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        launcher = subprocess.Popen(words, cwd=folder, env=environment(**(env or {})), **options)
        try:
            out, err = launcher.communicate()
        except BaseException:
            launcher.terminate()  # it ends the command and all that the command started
            launcher.wait()
            raise
        if launcher.returncode:
            raise RuntimeError(f"`{command[0]}` cannot be started: {err.strip().splitlines()[-1]}")
        text = Path(log.name).read_bytes()[-4000:].decode(errors="replace")
    return Cost(**json.loads(out), log=text)


def best(once: Callable[[], Cost], times: int, budget: float) -> Cost:
    """The quickest of several runs, with the greatest memory of all; ends at a failure or after `budget` seconds."""
    costs: list[Cost] = []
    while len(costs) < times and sum(one.seconds for one in costs) < budget:
        costs.append(once())
        if not costs[-1].ok:
            return costs[-1]
    return replace(min(costs, key=lambda one: one.seconds), rss_mib=max(one.rss_mib for one in costs))
