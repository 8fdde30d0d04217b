"""Results of stub backends, which are right in type and shape and mean nothing: no verb shows them unmarked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from dextera_build.explain.origins import Origins
from dextera_build.report.wording import STUB, some
from dextera_build.session import Session


def told(session: Session, node: str) -> str:
    """That stub backends made a node, or nodes that it depends on; "" if they made none.

    Args:
        session: The recipe.
        node: Its node; "" for its `Session.last_nodes`.
    """
    made = list(dict.fromkeys(name for name, backend in _backends(session, node) if backend == STUB))
    if not made:
        return ""
    return f"`{session.recipe}{':' * bool(node)}{node}` was made with stub backends: {some(made, 3)}"


def _backends(session: Session, node: str) -> Iterable[tuple[str, str | None]]:
    """Address and backend of the nodes, nearest first."""
    if node:
        yield node, session.document(node)["backend"]
        yield from map(_of, Origins(session.store).behind(session.past(node)))
    else:
        yield from map(_of, session.last_nodes.values())


def _of(event: Mapping[str, Any]) -> tuple[str, str | None]:
    return event["node"], event["backend"]
