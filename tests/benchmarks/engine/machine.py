"""The machine and the versions that a table belongs to."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

from tests.benchmarks.engine.tools.tool import REPO, Tool


def machine(work: Path) -> dict[str, str]:
    """Facts of the machine, as text."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processor": f"{_processor()}, {len(os.sched_getaffinity(0))} cores",
        "memory": f"{memory:.0f} GiB",
        "file system": _file_system(work),
        "system": f"{platform.system()} {platform.release()}",
        "Python": platform.python_version(),
        "begun": time.strftime("%Y-%m-%d %H:%M"),
        "load when begun": load(),
    }


def load() -> str:
    """Load averages."""
    return " ".join(f"{value:.1f}" for value in os.getloadavg())


def versions(tools: Mapping[str, Tool]) -> dict[str, str]:
    """Tool -> version, with the commit for this project; "" is an absent tool."""
    found = {name: tool.version() for name, tool in tools.items()}
    commit = ["git", "-C", str(REPO), "describe", "--always", "--dirty", "--exclude=*"]
    done = subprocess.run(commit, capture_output=True, text=True)
    if found.get("dxb") and done.returncode == 0:
        found["dxb"] += f" ({done.stdout.strip()})"
    return found


def _processor() -> str:
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _file_system(path: Path) -> str:
    done = subprocess.run(["stat", "-f", "-c", "%T", str(path)], capture_output=True, text=True)
    return done.stdout.strip() or "?"
