"""The record of a settled node, which is also its event."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from dextera_build.engine.states import State
from dextera_build.engine.units import Node, Unit, producers
from dextera_build.errors import DxbError
from dextera_build.runs.events import NodeFinished


def record_of(node: Node, project: str, blockers: Sequence[str] = ()) -> NodeFinished:
    """The record of a settled node.

    Args:
        node: A node that is done or failed, or will never run.
        project: Folder that paths are relative to.
        blockers: Addresses of the failed units that it waits for.
    """
    status, rule = node.status, node.rule
    assert status is not None, f"{node.address} has no status"
    made = node.result if node.state is State.DONE else None
    last = node.last if status in ("ran", "failed") else None
    called = (last.reply or {}).get("calls") if last else None
    seconds = node.fetched_s if status == "fetched" else made.seconds if made else last.seconds if last else 0.0
    return NodeFinished(
        time=time.time(),
        node=node.address,
        rule=rule.path,
        backend=rule.backend,
        status=status,
        key=node.key,
        output=made.output if made else None,
        seconds=seconds,
        line=made.line if made else "",
        result=made.digest if made else None,
        error=node.error,
        blocked_by=list(blockers),
        inputs=node.inputs,
        depends_on=[source.address for source in producers(node)],
        log=made.log if made else node.log,
        files={slot: _shown(path, project) for slot, path in node.call.files().items()},
        remote=node.remote if status == "fetched" else "",
        usage=last.usage if last else {},
        tries=node.tries,
        calls=list(called or (made.called if made else ())),
    )


def record_of_group(unit: Unit, error: DxbError) -> NodeFinished:
    """The record of a group that cannot be opened, or of a collection that cannot be gathered."""
    depends_on = [source.address for source in producers(unit)]
    return NodeFinished(
        time.time(), unit.address, "each", None, "failed", None, None, 0.0, error=error, depends_on=depends_on
    )


def _shown(path: Path, project: str) -> str:
    return str(path.relative_to(project)) if project and path.is_relative_to(project) else str(path)
