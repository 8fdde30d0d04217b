"""What a machine has to share out among nodes, and what one node asks for.

`cpu` counts cores, `memory` is in GiB, `gpu` counts devices, `gpu_memory` is in GiB a device; everything else has a
name with a colon, `licence:solver`, and is a count that the configuration declares.
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
"""Resources that a machine is asked for; the configuration may say otherwise."""

_NAMED = re.compile(r"[A-Za-z][\w.-]*:[\w.:/-]+")
_GROUP = Path("/sys/fs/cgroup")
_QUERY = ["nvidia-smi", "--query-gpu=uuid,memory.total", "--format=csv,noheader,nounits"]


@dataclass(frozen=True)
class Gpu:
    """One device."""

    id: str
    """What `CUDA_VISIBLE_DEVICES` calls it."""
    memory_gb: float = 0.0
    """0 where that is not known; then one task at a time has it."""


@dataclass(frozen=True)
class Capacity:
    """What there is to share out."""

    cpus: int = 1
    memory_gb: float = 1.0
    gpus: tuple[Gpu, ...] = ()
    named: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Needs:
    """What one task asks for."""

    cpus: int = 1
    memory_gb: float = 0.0
    gpus: int = 0
    """Devices that it has to itself."""
    gpu_gb: float = 0.0
    """Memory on each of them [GiB]; without `gpus`, that much of one device that others may share."""
    named: tuple[tuple[str, float], ...] = ()

    def lacks(self, capacity: Capacity) -> dict[str, tuple[float, float]]:
        """Resource -> (wanted, there), for all that no waiting will bring: devices and named resources."""
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
        UsageError: It is neither, names nothing that is known, or an amount is no number from zero up.
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
    """What this machine has, where the configuration does not say otherwise.

    Args:
        cpus: Cores to share out.
        said: Amounts of the configuration and the command line; see `parse`.
        gpus: Look for devices. That starts a program, so a build that needs none leaves it out.
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
    """Memory that new processes may use without swapping or leaving their control group [GiB]."""
    with open("/proc/meminfo") as table:
        rows = dict(line.split(":", 1) for line in table)
    return max(min(int(rows["MemAvailable"].split()[0]) / 2**20, _limit_gb()), 0.25)


def _limit_gb() -> float:
    """What the control group leaves [GiB]."""
    with suppress(OSError, ValueError):
        # Cached file pages count as used and are given back, so this is what is left at least.
        return (int((_GROUP / "memory.max").read_text()) - int((_GROUP / "memory.current").read_text())) / 2**30
    return math.inf


def _devices() -> list[Gpu]:
    import subprocess  # slow to import, and few builds need it

    try:
        answer = subprocess.run(_QUERY, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return []
    rows = [line.split(",") for line in answer.stdout.splitlines() if answer.returncode == 0 and "," in line]
    found = [Gpu(row[0].strip(), float(row[1]) / 1024) for row in rows if row[1].strip().isdigit()]
    return _visible(found)


def _visible(found: list[Gpu]) -> list[Gpu]:
    """Those that this process may use, under the names that it was given for them."""
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
