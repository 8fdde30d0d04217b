"""From what rules ask for to what Ray reserves, and from what nodes of a cluster have to what a build shares out."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Mapping
from typing import TypeAlias

from dextera_build.errors import MachineError
from dextera_build.workers.capacity import MEASURED, Capacity, Gpu, Needs

Amounts: TypeAlias = Mapping[str, float]
"""What a node has or a call reserves, by Ray's names: `CPU`, `GPU`, `memory` [bytes], or one that nodes declare."""

_GIB = 2**30
_FINEST = 100
"""Parts of a GPU are counted in hundredths."""


def capacity(nodes: Collection[Amounts], said: Mapping[str, float]) -> Capacity:
    """All nodes together.

    Args:
        nodes: What each has.
        said: Amounts of the configuration: `cpu` is the most to use of the cluster, `gpu_memory` the memory of one of
            its GPUs [GiB], named resources count beside those that nodes declare.
    """
    totals = defaultdict[str, float](float)
    for name, amount in (item for node in nodes for item in node.items()):
        totals[name] += amount
    cpus = int(min(totals["CPU"], said.get("cpu") or math.inf))
    gpus = tuple(Gpu(str(number), said.get("gpu_memory", 0.0)) for number in range(int(totals["GPU"])))
    # Ray itself adds resources for addresses and kinds of devices.
    own = [name for name in totals if ":" in name and not name.startswith(("node:", "accelerator_type:"))]
    named = {name: totals[name] for name in own} | {n: amount for n, amount in said.items() if n not in MEASURED}
    return Capacity(max(cpus, 1), max(totals["memory"] / _GIB, 0.25), gpus, named)


def shape(needs: Needs, nodes: Collection[Amounts], gpu_memory_gb: float = 0.0) -> Amounts:
    """What a call with `needs` reserves. More cores or memory than a node has become all that it has.

    Args:
        needs: What the rule declares.
        nodes: What each node has.
        gpu_memory_gb: Memory of one GPU; 0 where it is not known, then a call that wants a part of one has it whole.

    Raises:
        MachineError: No single node has the GPUs and the named resources, or there is no node.
    """
    if not nodes:
        raise MachineError(
            "no machine of the cluster is left",
            code="DXB-E354",
            hint="`ray status` lists nodes; finished results are kept, build again",
        )
    # Resources that only the configuration names are counted by the driver; Ray knows nothing of them.
    counted = {name for node in nodes for name in node}
    fixed = {name: amount for name, amount in needs.named if name in counted}
    if needs.gpus:
        fixed["GPU"] = float(needs.gpus)
    elif needs.gpu_gb:
        part = needs.gpu_gb / gpu_memory_gb if gpu_memory_gb else 1.0
        fixed["GPU"] = min(math.ceil(part * _FINEST) / _FINEST, 1.0)
    wish = {"CPU": float(max(needs.cpus, 1)), "memory": float(math.ceil(needs.memory_gb * _GIB))}
    given = [{n: min(wish[n], node.get(n, 0.0)) for n in wish} for node in nodes if fits(fixed, node)]
    if not given:
        wanted = ", ".join(f"{amount:g} of `{name}`" for name, amount in fixed.items())
        most = {name: max(node.get(name, 0.0) for node in nodes) for name in fixed}
        raise MachineError(
            f"it needs {wanted} on one node, which no node of the cluster has",
            code="DXB-E352",
            facts={f"most `{name}` of a node": f"{amount:g}" for name, amount in most.items()},
            hint="choose another backend, or add a node that has all of it: `ray start --address=HOST:PORT`",
        )
    best = max(given, key=lambda amounts: (amounts["CPU"], amounts["memory"]))
    return {name: amount for name, amount in (best | fixed).items() if amount}


def fits(wanted: Amounts, node: Amounts) -> bool:
    """Whether a node has so much in all."""
    return all(node.get(name, 0.0) >= amount for name, amount in wanted.items())


def options(reserved: Amounts) -> dict[str, object]:
    """What a call reserves as the options of a Ray task."""
    amounts = dict(reserved)
    cpus, gpus, memory = (amounts.pop(name, 0.0) for name in ("CPU", "GPU", "memory"))
    return {"num_cpus": cpus, "num_gpus": gpus, "memory": int(memory) or None, "resources": amounts or None}
