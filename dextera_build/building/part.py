"""A part of a node's result, addressed by the names of fields behind the node: `body[mug].mesh.mesh`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from dextera_build.building.export import stem_of
from dextera_build.errors import Place
from dextera_build.recipe.kinds import field_type
from dextera_build.session import node_among
from dextera_build.store import headers

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Artifact
    from dextera_build.session import Session


class Part(NamedTuple):
    """An artifact within a result, or the whole of it."""

    node: str
    fields: tuple[str, ...] = ()
    """Fields of fields, and labels of a collection; () for the whole result."""

    @property
    def stem(self) -> str:
        """The name of its files: `mesh` for `body[mug].mesh.mesh`."""
        return self.fields[-1] if self.fields else stem_of(self.node)


def named(session: Session, address: str) -> Part:
    """The part that an address names; fields follow the longest address of a node that was built.

    An address that begins with no such node is taken for that of a node.
    """
    node = node_among(session.history, address)
    return Part(node, tuple(address[len(node) + 1 :].split("."))) if node and node != address else Part(address)


def digest_of(session: Session, part: Part) -> str:
    """Digest of the part's header.

    Raises:
        UsageError: The node was never built.
        RuleError: A field does not exist or is no artifact, or the store no longer holds the result.
    """
    return headers.project(session.store.blobs.get, session.output(part.node), part.fields)


def artifact(session: Session, part: Part) -> Artifact:
    """The part, decoded; nothing else of the result is read.

    Raises:
        DxbError: See `digest_of`.
    """
    from dextera_build.artifacts.core.forms import type_among

    if not part.fields:
        return session.artifact(part.node)
    digest, reader = digest_of(session, part), session.store.reader
    rule = session.project.library.find(str(session.document(part.node)["rule"])).rule
    with headers.reading(f"`{part.node}`"):
        whole = type_among(rule.returns, session.output(part.node), reader)
        kind = field_type(whole, part.fields, Place("the command line"))
        found: Artifact = type_among(kind, digest, reader).decode(digest, reader)
    return found
