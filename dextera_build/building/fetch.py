"""The remotes that a command uses, and their contents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError, listing

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.session import Session

_ASKERS = 16


def exchange(session: Session, mode: str, named: str | None = None) -> Exchange:
    """The remotes to use for reading only or for writing only.

    Args:
        session: The session with the store.
        mode: `r` or `w`.
        named: A remote's name or address; None for those that the settings allow for `mode`.

    Raises:
        UsageError: There is no such remote.
    """
    from dextera_build.remotes import spec as specs
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.remotes.spec import guarded, open_remote

    choice = session.project.remotes
    known = choice.known if session.project.config else {}
    used = [specs.named(named, known)] if named else [spec for spec in choice.used if mode in spec.mode]
    if not used:
        flag, does = ("--to", "written") if mode == "w" else ("--from", "read")
        raise UsageError(
            f"no remote may be {does}",
            code="DXB-U136",
            facts={"remotes": listing(f"{name} ({spec.mode})" for name, spec in known.items())},
            hint=f"name one: `{flag} NAME`, or `{flag} https://host/prefix`",
        )
    session.project.allowed([replace(spec, mode=mode) for spec in used])
    for spec in used:
        open_remote(spec).close()  # report a wrong address or missing packages before doing anything
    return Exchange(session.store, [guarded(replace(spec, mode=mode)) for spec in used])


def usable(session: Session) -> Exchange | None:
    """The remotes that the settings allow a build to use, or None if there are none."""
    used = session.project.used_remotes
    if not used or session.project.remotes.local == "r":
        return None
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.remotes.spec import guarded

    return Exchange(session.store, [guarded(spec) for spec in used])


def bring(session: Session, nodes: Iterable[str]) -> list[str]:
    """Download the bytes of bare results from the remotes that a build uses; the nodes that are still bare."""
    bare = {node: key for node in nodes if session.is_bare(key := session.past(node).key)}
    remotes = usable(session) if bare else None
    if remotes is not None:
        try:
            for key in bare.values():
                remotes.fetch(key)
        finally:
            remotes.close()
    return [node for node, key in bare.items() if session.is_bare(key)]


def held(session: Session, nodes: Sequence[Planned]) -> set[str]:
    """Addresses of the stale nodes whose results a remote has; reads only entries, no blobs."""
    used = [spec for spec in session.project.used_remotes if "r" in spec.mode]
    if not used or session.project.remotes.local == "r":
        return set()
    stale = [node for node in nodes if node.status == "stale" and node.key is not None]
    if not stale:
        return set()
    from dextera_build.remotes.remote import RemoteFault
    from dextera_build.remotes.spec import guarded
    from dextera_build.remotes.threads import Crew
    from dextera_build.remotes.transfer import entry_at

    remotes, found = [guarded(spec) for spec in used], set[str]()

    def ask(node: Planned) -> None:
        for remote in remotes:
            with suppress(RemoteFault):
                if entry_at(remote, node.key or "") is not None:
                    found.add(node.address)
                    return

    Crew(_ASKERS, "dxb plan").each(ask, stale)
    for remote in remotes:
        remote.close()
    return found
