"""The results that a node was made from, at any distance, by their type."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.artifacts.base import Artifact
from dextera_build.errors import DxbError
from dextera_build.explain.origins import Event, Origins, document
from dextera_build.session import Session


def behind(session: Session, node: str) -> Iterator[tuple[str, Event]]:
    """Artifact type without version, and final event, of a node and of all that it depends on, nearest first."""
    for event in Origins(session.store).behind(session.past(node)):
        header = document(session.store, event["output"]) or {}
        yield str(header.get("artifact", "")).partition("@")[0], event


def found(session: Session, node: str, kind: type[Artifact]) -> Iterator[tuple[str, Artifact]]:
    """Address and artifact of the results of one type, nearest first; results that the store lost are left out."""
    for name, event in behind(session, node):
        if name == kind.name():
            try:
                yield event["node"], session.decoded(event["node"], event["rule"], event["output"])
            except DxbError:
                continue
