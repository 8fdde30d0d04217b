"""Values of single nodes of a recipe, built as far as they are stale: for verbs about a photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dextera_build.building import build as building
from dextera_build.building.lock import Locking
from dextera_build.engine.graph import Call, Output
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.engine.run import RunResult
    from dextera_build.runs.events import Listener


def output_of(call: Call, slot: str) -> Output:
    """The node, and the fields of its output, that an input of a call reads."""
    source = call.inputs[slot]
    assert isinstance(source, Output), f"`{slot}` is the output of a node"
    return source


def run(session: Session, nodes: tuple[str, ...], listen: Listener) -> RunResult:
    """Build nodes, without exports and pins."""
    locking = Locking(session.project, lock=False, locked=False, added=session.added)
    return building.build(session, building.Order(nodes), locking, listen).result


def raise_errors(result: RunResult) -> None:
    """Raise the first error of a run.

    Raises:
        DxbError: A node failed.
    """
    for error in result.errors.values():
        raise error


def value(session: Session, result: RunResult, node: str, fields: tuple[str, ...] = ()) -> Any:
    """Output of a node in a run, or a field of it."""
    record = result.nodes[node]
    found: Any = session.decoded(node, record.rule, str(record.output))
    for part in fields:
        found = getattr(found, part)
    return found
