"""Files, folders, collections and matches: lines of text without pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from dextera_build.artifacts.base import Artifact, Collection, File, Folder
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.artifacts.core.lazy import sizes
from dextera_build.previews import text


def _facts_of_file(file: File) -> Iterator[str]:
    """Its size; content outside memory is not read for it."""
    yield text.size(file.size)


def _facts_of_folder(tree: Folder) -> Iterator[str]:
    """Number of files, and their size."""
    yield from text.facts({"files": tree.files}, {})
    yield text.size(sum(sizes(tree.files)))


def _facts_of_collection(found: Collection[Any]) -> Iterator[str]:
    """Number and type of the items, with their labels."""
    kinds = sorted({item.name() for item in found.items.values()})
    yield from text.facts({" or ".join(kinds) or "items": found.items}, {})


def _facts_of_matches(matches: Matches) -> Iterator[str]:
    """Number of pairs, and the method."""
    yield f"{len(matches.first)} pairs"
    yield matches.method


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    File: _facts_of_file,
    Folder: _facts_of_folder,
    Collection: _facts_of_collection,
    Matches: _facts_of_matches,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {}
