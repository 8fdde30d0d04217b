"""Several machines, each a store of its own, and a server between them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from tests import documents
from tests.e2e.space import Answer, Space

EVERY = {"start", "words", "all", *(f"word[{w}].{n}" for w in ("one", "two") for n in ("loud", "louder"))}
"""The nodes of `say/words`."""


def machine(space: Space, name: str, *words: str, use: str = "") -> Answer:
    """Build on a machine with a store of its own; `use` is the list of remotes."""
    return space.dxb("build", "--console", "jsonl", *words, env={"DXB_CACHE": name, "DXB_REMOTES": use})


def results(space: Space, name: str) -> dict[str, bytes]:
    """Every result and blob of a store."""
    root = space.root / name
    files = {str(path.relative_to(root)): path for kind in ("ac", "cas") for path in (root / kind).rglob("*")}
    return {place: path.read_bytes() for place, path in files.items() if path.is_file()}


def agree(space: Space, name: str, other: str) -> bool:
    """Whether a store knows the same results as another one and holds no blob that the other lacks."""
    ours, theirs = results(space, name), results(space, other)
    known, made = ({place for place in found if place.startswith("ac/")} for found in (ours, theirs))
    return known == made and all(theirs.get(place) == data for place, data in ours.items() if place not in known)


def uploads(answer: Answer) -> list[tuple[int, int]]:
    return [(event["results"], event["left"]) for event in answer.events if event["event"] == "uploaded"]


def given_up(answer: Answer) -> list[dict]:
    return [event for event in answer.events if event["event"] == "remote_given_up"]


@contextmanager
def serving(space: Space, name: str, *words: str) -> Iterator[str]:
    server = space.start("cache", "serve", "--port", "0", "--cache", name, "--json", *words)
    try:
        assert server.stdout is not None
        yield documents.read(server.stdout.readline())["url"]
    finally:
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=60)
        assert server.returncode == 0, said
