"""A run as a trace for Perfetto, Chrome's `about:tracing` and speedscope (Trace Event Format, JSON object form).

The process is dxb, a thread is a worker slot. A node is a complete event (`X`) with its key, rule, status and
line; counters (`C`) give the number of running nodes and their memory, flow events (`s`, `f`) join the critical
path. Times are microseconds since the run began.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from dextera_build.report.run import Node, Run
from dextera_build.report.timeline import assign_slots, critical_path

Event = dict[str, Any]
_PID = 1
_COLOURS = {"failed": "terrible", "cancelled": "bad"}


def trace(run: Run) -> dict[str, Any]:
    """The trace as plain data."""
    events = [*_names(run), *_slices(run), *_instants(run), *_counters(run), *_flows(run)]
    return {
        "traceEvents": events,
        "displayTimeUnit": "ms",
        "otherData": {"run": run.name, "recipe": run.recipe, "profile": run.profile, "dxb": run.dxb},
    }


def _names(run: Run) -> Iterator[Event]:
    yield _meta("process_name", 0, {"name": f"dxb build {run.recipe}"})
    yield _meta("thread_name", 0, {"name": "from the store"})
    slots = sorted(set(assign_slots(_worked(run)).values()))
    for slot in slots:
        yield _meta("thread_name", slot + 1, {"name": f"worker {slot + 1}"})
        yield _meta("thread_sort_index", slot + 1, {"sort_index": slot + 1})


def _meta(name: str, thread: int, args: dict[str, Any]) -> Event:
    return {"name": name, "ph": "M", "pid": _PID, "tid": thread, "ts": 0, "args": args}


def _slices(run: Run) -> Iterator[Event]:
    slots = assign_slots(_worked(run))
    for node in _worked(run):
        event: Event = {
            "name": node.address,
            "cat": node.rule,
            "ph": "X",
            "ts": _micro(node.began),
            "dur": max(_micro(node.ended) - _micro(node.began), 1),
            "pid": _PID,
            "tid": slots[node.index] + 1,
            "args": _args(node),
        }
        if node.status in _COLOURS:
            event["cname"] = _COLOURS[node.status]
        yield event


def _instants(run: Run) -> Iterator[Event]:
    """One instant event for each node that took no worker."""
    for node in run.nodes:
        if not node.worked:
            yield {
                "name": node.address,
                "cat": node.rule,
                "ph": "i",
                "s": "t",
                "ts": _micro(node.ended),
                "pid": _PID,
                "tid": 0,
                "args": _args(node),
            }


def _args(node: Node) -> dict[str, Any]:
    known: dict[str, Any] = {
        "key": node.key,
        "rule": node.rule,
        "backend": node.backend,
        "status": node.status,
        "line": node.line,
    }
    if node.tries > 1:
        known["tries"] = node.tries
    if node.error:
        known["error"] = node.error.get("message")
    return {**{name: value for name, value in known.items() if value}, **node.usage}


def _counters(run: Run) -> Iterator[Event]:
    """Counters at each start and end of a node: running nodes, processors in use, sum of their peak memory."""
    steps: dict[int, list[float]] = {}
    for node in _worked(run):
        busy = node.usage.get("cpu_seconds", 0.0) / max(node.seconds, 1e-6)
        amounts = (1.0, busy, node.usage.get("memory_bytes", 0.0) / 2**20)
        began, ended = _micro(node.began), max(_micro(node.ended), _micro(node.began) + 1)
        for when, sign in ((began, 1), (ended, -1)):
            step = steps.setdefault(when, [0.0, 0.0, 0.0])
            for place, amount in enumerate(amounts):
                step[place] += sign * amount
    level = [0.0, 0.0, 0.0]
    for when, step in sorted(steps.items()):
        level = [max(old + change, 0.0) for old, change in zip(level, step, strict=True)]
        for name, unit, value in zip(
            ("nodes", "processors in use", "memory in use"), ("count", "cores", "MiB"), level, strict=True
        ):
            yield {
                "name": name,
                "cat": "use",
                "ph": "C",
                "ts": when,
                "pid": _PID,
                "tid": 0,
                "args": {unit: round(value, 3)},
            }


def _flows(run: Run) -> Iterator[Event]:
    slots = assign_slots(_worked(run))
    path = critical_path(run)
    for number, (before, after) in enumerate(pairwise(path), start=1):
        common = {"name": "critical path", "cat": "critical path", "id": number, "pid": _PID}
        # A flow binds to the slice that contains it, so it starts and ends inside the slices.
        leaves = max(_micro(before.ended) - 1, _micro(before.began))
        yield {**common, "ph": "s", "ts": leaves, "tid": slots[before.index] + 1}
        arrives = max(_micro(after.began), leaves)
        yield {**common, "ph": "f", "bp": "e", "ts": arrives, "tid": slots[after.index] + 1}


def _worked(run: Run) -> list[Node]:
    return [node for node in run.nodes if node.worked]


def _micro(seconds: float) -> int:
    return max(round(seconds * 1e6), 0)
