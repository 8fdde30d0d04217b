"""From what rules ask for to what Ray reserves, and from what nodes of a cluster have to what there is to share out."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from dextera_build.errors import MachineError
from dextera_build.workers.capacity import MEASURED, Capacity, Gpu, Needs

Shape: TypeAlias = tuple[tuple[str, float], ...]
"""What a call reserves, by Ray's names: `CPU`, `GPU`, `memory` [bytes], or a resource that nodes declare."""

_GIB = 2**30
_FINEST = 100
"""Parts of a GPU are counted in hundredths."""


def capacity(nodes: Mapping[str, Mapping[str, float]], said: Mapping[str, float]) -> Capacity:
    """All nodes together.

    Args:
        nodes: Node -> resource -> how much it has, by Ray's names.
        said: Amounts of the configuration: `cpu` is the most to use of the cluster, `gpu_memory` the memory of one of
            its GPUs [GiB], named resources count beside those that nodes declare.
    """
    totals: dict[str, float] = {}
    for amounts in nodes.values():
        for name, amount in amounts.items():
            totals[name] = totals.get(name, 0.0) + amount
    cpus = int(min(totals.get("CPU", 0.0), said.get("cpu") or math.inf))
    gpus = tuple(
        Gpu(f"{node[:8]}:{number}", said.get("gpu_memory", 0.0))
        for node, amounts in nodes.items()
        for number in range(int(amounts.get("GPU", 0.0)))
    )
    named = {name: amount for name, amount in totals.items() if _is_named(name)}
    named |= {name: amount for name, amount in said.items() if name not in MEASURED}
    return Capacity(max(cpus, 1), max(totals.get("memory", 0.0) / _GIB, 0.25), gpus, named, is_cluster=True)


def shape(needs: Needs, nodes: Iterable[Mapping[str, float]], gpu_memory_gb: float = 0.0) -> Shape:
    """What a call with `needs` reserves. More cores or memory than a node has become all that it has.

    Args:
        needs: What the rule declares.
        nodes: What each node has.
        gpu_memory_gb: Memory of one GPU; 0 where it is not known, then who wants a part of one has it whole.

    Raises:
        MachineError: No single node has the GPUs and the named resources, or there is no node.
    """
    nodes = list(nodes)
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
    best: dict[str, float] | None = None
    for node in nodes:
        if not fits(fixed.items(), node):
            continue
        given = {name: min(amount, node.get(name, 0.0)) for name, amount in wish.items()}
        if best is None or (given["CPU"], given["memory"]) > (best["CPU"], best["memory"]):
            best = given
    if best is None:
        raise _nowhere(fixed, nodes)
    return tuple(sorted({name: amount for name, amount in (best | fixed).items() if amount}.items()))


def fits(shape: Iterable[tuple[str, float]], node: Mapping[str, float]) -> bool:
    """Whether a node has so much in all."""
    return all(node.get(name, 0.0) >= amount for name, amount in shape)


def options(reserved: Shape) -> dict[str, object]:
    """`shape` as the options of a Ray task or actor."""
    amounts = dict(reserved)
    cpus, gpus, memory = (amounts.pop(name, 0.0) for name in ("CPU", "GPU", "memory"))
    return {"num_cpus": cpus, "num_gpus": gpus, "memory": int(memory) or None, "resources": amounts or None}


def _is_named(resource: str) -> bool:
    """Whether it is one that rules may ask for; Ray itself adds some for addresses and kinds of devices."""
    return ":" in resource and not resource.startswith(("node:", "accelerator_type:"))


def _nowhere(fixed: Mapping[str, float], nodes: list[Mapping[str, float]]) -> MachineError:
    wanted = ", ".join(f"{amount:g} of `{name}`" for name, amount in fixed.items())
    gpus = fixed.get("GPU", 0.0)
    words = [f"--num-gpus={math.ceil(gpus)}"] if gpus else []
    if named := {name: amount for name, amount in fixed.items() if name != "GPU"}:
        words.append(f"--resources='{json.dumps(named)}'")
    most = {name: max((node.get(name, 0.0) for node in nodes), default=0.0) for name in fixed}
    return MachineError(
        f"it needs {wanted} on one node, which no node of the cluster has",
        code="DXB-E352",
        facts={f"most `{name}` of a node": f"{amount:g}" for name, amount in most.items()},
        hint=f"choose another backend, or add a node: `ray start --address=HOST:PORT {' '.join(words)}`",
    )
