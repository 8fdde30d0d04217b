"""Resources of a machine, and the needs of a node.

`cpu` counts cores, `memory` is in GiB, `gpu` counts devices, `gpu_memory` is in GiB per device; every other resource
has a name with a colon, `licence:solver`, and a count declared in the configuration.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.errors import UsageError, did_you_mean

MEASURED = ("cpu", "memory", "gpu", "gpu_memory")
"""Resources measured on the machine unless the configuration sets them."""

_NAMED = re.compile(r"[A-Za-z][\w.-]*:[\w.:/-]+")
_GROUP = Path("/sys/fs/cgroup")
_QUERY = ["nvidia-smi", "--query-gpu=uuid,memory.total", "--format=csv,noheader,nounits"]


@dataclass(frozen=True)
class Gpu:
    """One device."""

    id: str
    """Its name in `CUDA_VISIBLE_DEVICES`."""
    memory_gb: float = 0.0
    """0 if unknown; the device then runs one task at a time."""


@dataclass(frozen=True)
class Capacity:
    """Resources to share among tasks."""

    cpus: int = 1
    memory_gb: float = 1.0
    gpus: tuple[Gpu, ...] = ()
    named: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Needs:
    """Resources that one task needs."""

    cpus: int = 1
    memory_gb: float = 0.0
    gpus: int = 0
    """Number of exclusive devices."""
    gpu_gb: float = 0.0
    """Memory on each of them [GiB]; without `gpus`, memory on one shared device."""
    named: tuple[tuple[str, float], ...] = ()

    def lacks(self, capacity: Capacity) -> dict[str, tuple[float, float]]:
        """Resource -> (wanted, available) for devices and named resources that exceed the capacity."""
        found: dict[str, tuple[float, float]] = {}
        devices = max(self.gpus, 1 if self.gpu_gb else 0)
        if devices > len(capacity.gpus):
            found["gpu"] = (devices, len(capacity.gpus))
        for name, amount in self.named:
            if amount > capacity.named.get(name, 0):
                found[name] = (amount, capacity.named.get(name, 0))
        return found


def parse(given: object, origin: str = "--resources") -> dict[str, float]:
    """Amounts by name, from `gpu=1,memory=16` or a table of the configuration.

    Raises:
        UsageError: It is neither, a resource is unknown, or an amount is not a number of at least zero.
    """
    if isinstance(given, str):
        parts = [part.rpartition("=") for part in given.split(",") if part.strip()]
        pairs: object = {name.strip(): value.strip() for name, _, value in parts}
    else:
        pairs = given
    if not isinstance(pairs, Mapping) or "" in pairs or "" in pairs.values():
        raise UsageError(
            f"`{given}` is not of the form `NAME=AMOUNT,...`",
            code="DXB-U172",
            facts={"from": origin},
            hint="`--resources gpu=1,memory=16`",
        )
    return {name: _amount(name, value, origin) for name, value in pairs.items()}


def measure(cpus: int, said: Mapping[str, float] | None = None, *, gpus: bool = True) -> Capacity:
    """The resources of this machine, overridden by the configuration.

    Args:
        cpus: Number of cores to use.
        said: Amounts from the configuration and the command line; see `parse`.
        gpus: Look for devices. This starts a program, so builds without GPU rules skip it.
    """
    said = said or {}
    found = _devices() if gpus and said.get("gpu", 1) else []
    if "gpu" in said:
        wanted = int(said["gpu"])
        found = [*found, *(Gpu(str(number)) for number in range(len(found), wanted))][:wanted]
    if "gpu_memory" in said:
        found = [Gpu(gpu.id, said["gpu_memory"]) for gpu in found]
    named = {name: amount for name, amount in said.items() if name not in MEASURED}
    return Capacity(int(said.get("cpu", cpus)) or 1, said.get("memory") or available_gb(), tuple(found), named)


def available_gb() -> float:
    """Memory available to new processes without swapping or exceeding the control group's limit [GiB]."""
    with open("/proc/meminfo") as table:
        rows = dict(line.split(":", 1) for line in table)
    return max(min(int(rows["MemAvailable"].split()[0]) / 2**20, _limit_gb()), 0.25)


def _limit_gb() -> float:
    """Memory left in the control group [GiB]."""
    with suppress(OSError, ValueError):
        # A lower bound: cached file pages count as used, but can be reclaimed.
        return (int((_GROUP / "memory.max").read_text()) - int((_GROUP / "memory.current").read_text())) / 2**30
    return math.inf


def _devices() -> list[Gpu]:
    import subprocess  # slow to import and rarely needed

    try:
        answer = subprocess.run(_QUERY, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return []
    rows = [line.split(",") for line in answer.stdout.splitlines() if answer.returncode == 0 and "," in line]
    found = [Gpu(row[0].strip(), float(row[1]) / 1024) for row in rows if row[1].strip().isdigit()]
    return _visible(found)


def _visible(found: list[Gpu]) -> list[Gpu]:
    """The devices that `CUDA_VISIBLE_DEVICES` allows for this process."""
    told = os.environ.get("CUDA_VISIBLE_DEVICES")
    if told is None:
        return found
    by_name = {str(place): gpu for place, gpu in enumerate(found)} | {gpu.id: gpu for gpu in found}
    names = [name.strip() for name in told.split(",") if name.strip()]
    return [by_name[name] for name in names if name in by_name]


def _amount(name: str, value: object, origin: str) -> float:
    if name not in MEASURED and not _NAMED.fullmatch(name):
        raise UsageError(
            f"`{name}` is not a resource",
            code="DXB-U170",
            facts={"from": origin, "resources": f"{', '.join(MEASURED)}, or a name with a colon: `licence:solver`"},
            hint=did_you_mean(name, MEASURED),
        )
    try:
        amount = float(str(value))
    except ValueError:
        amount = -1.0
    if isinstance(value, bool) or not 0 <= amount < 1e9:
        raise UsageError(
            f"resource `{name}` is a number from zero up, not `{value}`", code="DXB-U171", facts={"from": origin}
        )
    return amount
